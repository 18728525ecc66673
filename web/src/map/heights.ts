// The ground as heights on a grid: what the mesh, the lines on it and the pointer agree on.

import type { TerrainFrame } from "../api/contract";

export class Heights {
  /**
   * up_m: rows x columns, north row first, NaN where the map has no ground. The ground reaches to width_m and depth_m
   * from its north-west corner: that is where its cells end, but for cells that stand for blocks of a finer ground.
   */
  constructor(
    readonly frame: TerrainFrame,
    readonly up_m: Float32Array,
    readonly width_m = frame.columns * frame.cell_size_m,
    readonly depth_m = frame.rows * frame.cell_size_m,
  ) {
    if (up_m.length !== frame.rows * frame.columns) {
      throw new RangeError(`terrain of ${up_m.length} heights; ${frame.rows} x ${frame.columns} were announced`);
    }
  }

  static fromBytes(frame: TerrainFrame, buffer: ArrayBuffer): Heights {
    return new Heights(frame, new Float32Array(buffer));
  }

  get range_m(): [lowest: number, highest: number] {
    let lowest = Infinity;
    let highest = -Infinity;
    for (const up of this.up_m) {
      if (up < lowest) lowest = up;
      if (up > highest) highest = up;
    }
    return lowest <= highest ? [lowest, highest] : [0, 0];
  }

  get bounds(): [west: number, south: number, east: number, north: number] {
    const { west, north } = this.frame;
    return [west, north - this.depth_m, west + this.width_m, north];
  }

  /** Bilinear between the middles of cells, level from the outermost to the edge; NaN off the map and in its holes. */
  at(east: number, north: number): number {
    const { frame } = this;
    const right_m = east - frame.west;
    const down_m = frame.north - north;
    if (!(right_m >= 0 && down_m >= 0 && right_m <= this.width_m && down_m <= this.depth_m)) return NaN;
    const x = right_m / frame.cell_size_m - 0.5;
    const y = down_m / frame.cell_size_m - 0.5;
    const column = Math.max(Math.min(Math.floor(x), frame.columns - 2), 0);
    const row = Math.max(Math.min(Math.floor(y), frame.rows - 2), 0);
    const beside = Math.min(1, frame.columns - 1);
    const under = Math.min(1, frame.rows - 1) * frame.columns;
    const right = Math.min(Math.max(x - column, 0), 1);
    const down = Math.min(Math.max(y - row, 0), 1);
    const k = row * frame.columns + column;
    const upper = this.up_m[k] * (1 - right) + this.up_m[k + beside] * right;
    const lower = this.up_m[k + under] * (1 - right) + this.up_m[k + under + beside] * right;
    return upper * (1 - down) + lower * down;
  }

  /** The same ground, to the same edge, in cells `step` times as wide, each the mean of its block: at the last row and
   * column as much of a block as is left, and none where that is less than half. */
  thinned(step: number): Heights {
    if (step <= 1) return this;
    const { frame } = this;
    const rows = Math.max(Math.round(frame.rows / step), 1);
    const columns = Math.max(Math.round(frame.columns / step), 1);
    const up_m = new Float32Array(rows * columns);
    for (let row = 0; row < rows; row++) {
      for (let column = 0; column < columns; column++) {
        up_m[row * columns + column] = this.mean(row * step, column * step, step);
      }
    }
    return new Heights({ ...frame, cell_size_m: frame.cell_size_m * step, rows, columns }, up_m, this.width_m, this.depth_m);
  }

  private mean(row: number, column: number, step: number): number {
    let sum = 0;
    let count = 0;
    for (let i = row; i < Math.min(row + step, this.frame.rows); i++) {
      for (let j = column; j < Math.min(column + step, this.frame.columns); j++) {
        const up = this.up_m[i * this.frame.columns + j];
        if (up === up) {
          sum += up;
          count++;
        }
      }
    }
    return count === 0 ? NaN : sum / count;
  }

  /** Where a ray first meets the ground, or null. Marched by half a cell, then halved down. */
  meets(from: readonly number[], towards: readonly number[]): [number, number, number] | null {
    const length = Math.hypot(towards[0] - from[0], towards[1] - from[1], towards[2] - from[2]);
    const point = (t: number): [number, number, number] => [
      from[0] + (towards[0] - from[0]) * t,
      from[1] + (towards[1] - from[1]) * t,
      from[2] + (towards[2] - from[2]) * t,
    ];
    const below = (t: number) => {
      const [east, north, up] = point(t);
      return up <= this.at(east, north);
    };
    const step = this.frame.cell_size_m / 2 / length;
    for (let t = step; t <= 1; t += step) {
      if (!below(t)) continue;
      let [above, under] = [t - step, t];
      for (let k = 0; k < 12; k++) {
        const middle = (above + under) / 2;
        if (below(middle)) under = middle;
        else above = middle;
      }
      return point(under);
    }
    return null;
  }
}
