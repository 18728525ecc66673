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

/** Where cells have a vertex along a side: in their middle, and the outermost at the edge too, as `Heights.at` has it. */
interface Side {
  cells: number[];
  /** From the north-west corner. */
  at_m: number[];
}

function sideOf(count: number, cell_size_m: number, length_m: number): Side {
  const cells = Array.from({ length: count }, (_, cell) => cell);
  return { cells: [0, ...cells, count - 1], at_m: [0, ...cells.map((cell) => Math.min((cell + 0.5) * cell_size_m, length_m)), length_m] };
}

function sidesOf(heights: Heights): [rows: Side, columns: Side] {
  const { rows, columns, cell_size_m } = heights.frame;
  return [sideOf(rows, cell_size_m, heights.depth_m), sideOf(columns, cell_size_m, heights.width_m)];
}

/** (0, 0) of the texture is the north-west corner, (1, 1) the south-east one. */
export function terrainMesh(heights: Heights): Mesh {
  const { frame, width_m, depth_m } = heights;
  const [rows, columns] = sidesOf(heights);
  const across = columns.cells.length;
  const ups = rows.cells.flatMap((row) => columns.cells.map((column) => heights.up_m[row * frame.columns + column]));
  const positions = new Float32Array(3 * ups.length);
  const texCoords = new Float32Array(2 * ups.length);
  ups.forEach((up, k) => {
    const [right_m, down_m] = [columns.at_m[k % across], rows.at_m[Math.floor(k / across)]];
    positions.set([frame.west + right_m, frame.north - down_m, up === up ? up : 0], 3 * k);
    texCoords.set([right_m / width_m, down_m / depth_m], 2 * k);
  });
  const indices: number[] = [];
  const there = (k: number) => ups[k] === ups[k];
  for (let row = 0; row + 1 < rows.cells.length; row++) {
    for (let column = 0; column + 1 < across; column++) {
      const k = row * across + column;
      const [right, down, opposite] = [k + 1, k + across, k + across + 1];
      if (there(k) && there(right) && there(down)) indices.push(k, down, right);
      if (there(right) && there(down) && there(opposite)) indices.push(right, down, opposite);
    }
  }
  return mesh(positions, texCoords, indices);
}

/** Walls from the edge of the map down to `floor_m`. */
export function skirtMesh(heights: Heights, floor_m: number): Mesh {
  const { frame, width_m, depth_m } = heights;
  const [rows, columns] = sidesOf(heights);
  const positions: number[] = [];
  const indices: number[] = [];
  const wall = (side: Side, top: (n: number) => [right_m: number, down_m: number, up: number]) => {
    for (let n = 0; n + 1 < side.cells.length; n++) {
      const ends = [top(n), top(n + 1)];
      if (ends.some(([, , up]) => up !== up)) continue;
      const first = positions.length / 3;
      for (const [right_m, down_m, up] of ends) {
        const [east, north] = [frame.west + right_m, frame.north - down_m];
        positions.push(east, north, up, east, north, floor_m);
      }
      indices.push(first, first + 1, first + 2, first + 2, first + 1, first + 3);
    }
  };
  const up = (row: number, column: number) => heights.up_m[row * frame.columns + column];
  for (const [row, down_m] of [[0, 0], [frame.rows - 1, depth_m]]) wall(columns, (n) => [columns.at_m[n], down_m, up(row, columns.cells[n])]);
  for (const [column, right_m] of [[0, 0], [frame.columns - 1, width_m]]) wall(rows, (n) => [right_m, rows.at_m[n], up(rows.cells[n], column)]);
  return mesh(positions, new Array((positions.length / 3) * 2).fill(0), indices);
}
