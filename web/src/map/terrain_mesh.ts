// Heights -> triangles, and a skirt around them, so that the map reads as a block of ground.

import type { Heights } from "./heights";

export interface Mesh {
  attributes: Record<string, { value: Float32Array; size: number }>;
  indices: { value: Uint32Array; size: number };
}

export function mesh(positions: number[] | Float32Array, texCoords: number[] | Float32Array, indices: number[]): Mesh {
  return {
    attributes: {
      positions: { value: Float32Array.from(positions), size: 3 },
      texCoords: { value: Float32Array.from(texCoords), size: 2 },
    },
    indices: { value: Uint32Array.from(indices), size: 1 },
  };
}

/** (0, 0) of the texture is the north-west corner of `whole`, of which `heights` may hold every nth cell. */
export function terrainMesh(heights: Heights, whole: Heights): Mesh {
  const { rows, columns } = heights.frame;
  const positions = new Float32Array(3 * rows * columns);
  const texCoords = new Float32Array(2 * rows * columns);
  const width_m = whole.frame.columns * whole.frame.cell_size_m;
  const depth_m = whole.frame.rows * whole.frame.cell_size_m;
  for (let row = 0; row < rows; row++) {
    for (let column = 0; column < columns; column++) {
      const k = row * columns + column;
      const up = heights.up_m[k];
      positions.set([heights.east(column), heights.north(row), up === up ? up : 0], 3 * k);
      texCoords[2 * k] = (heights.east(column) - whole.frame.west) / width_m;
      texCoords[2 * k + 1] = (whole.frame.north - heights.north(row)) / depth_m;
    }
  }
  const indices: number[] = [];
  const there = (k: number) => heights.up_m[k] === heights.up_m[k];
  for (let row = 0; row + 1 < rows; row++) {
    for (let column = 0; column + 1 < columns; column++) {
      const k = row * columns + column;
      const [right, down, across] = [k + 1, k + columns, k + columns + 1];
      if (there(k) && there(right) && there(down)) indices.push(k, down, right);
      if (there(right) && there(down) && there(across)) indices.push(right, down, across);
    }
  }
  return mesh(positions, texCoords, indices);
}

/** Walls from the edge of the map down to `floor_m`. */
export function skirtMesh(heights: Heights, floor_m: number): Mesh {
  const { rows, columns } = heights.frame;
  const positions: number[] = [];
  const indices: number[] = [];
  const wall = (k: number[]) => {
    for (let i = 0; i + 1 < k.length; i++) {
      const [a, b] = [heights.up_m[k[i]], heights.up_m[k[i + 1]]];
      if (a !== a || b !== b) continue;
      const first = positions.length / 3;
      for (const j of [k[i], k[i + 1]]) {
        const [east, north] = [heights.east(j % columns), heights.north(Math.floor(j / columns))];
        positions.push(east, north, heights.up_m[j], east, north, floor_m);
      }
      indices.push(first, first + 1, first + 2, first + 2, first + 1, first + 3);
    }
  };
  const along = (length: number, at: (n: number) => number) => wall(Array.from({ length }, (_, n) => at(n)));
  along(columns, (n) => n);
  along(columns, (n) => (rows - 1) * columns + n);
  along(rows, (n) => n * columns);
  along(rows, (n) => n * columns + columns - 1);
  return mesh(positions, new Array((positions.length / 3) * 2).fill(0), indices);
}
