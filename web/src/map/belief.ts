// What is known about the ground: one entry per column that was ever looked at, as the service packs it.

/** The codes of `crowdfence.VoxelState`. */
export enum VoxelState {
  neverSeen = 0,
  occluded = 1,
  empty = 2,
  stale = 3,
  crowd = 4,
  notCleared = 5,
}

/** Of the states that fall on one spot the least known is shown, and crowd before all: `surface_grid.py`. */
const LEAST_TO_MOST_URGENT = [
  VoxelState.empty,
  VoxelState.stale,
  VoxelState.notCleared,
  VoxelState.occluded,
  VoxelState.neverSeen,
  VoxelState.crowd,
];
export const URGENCY: readonly number[] = Array.from({ length: 6 }, (_, state) =>
  LEAST_TO_MOST_URGENT.indexOf(state),
);

export const OLDER_THAN_KNOWN = 65_535;

export interface Belief {
  stamp_ns: string;
  count: number;
  cell_size_m: number;
  west: number;
  south: number;
  /** Per column: from the west, from the south. */
  columns: Uint16Array;
  rows: Uint16Array;
  up_m: Float32Array;
  /** Largest probability of the column, times 255. */
  probability: Uint8Array;
  state: Uint8Array;
  /** Of the newest look, in tenths of a second; 65535: older. */
  age: Uint16Array;
}

const HEADER_BYTES = 24;
const COLUMN_BYTES = 12;

/** Throws RangeError for anything that is not whole: half a map must never look like a map. */
export function parseBelief(buffer: ArrayBuffer): Belief {
  if (buffer.byteLength < HEADER_BYTES) throw new RangeError(`belief of ${buffer.byteLength} bytes`);
  const header = new DataView(buffer);
  const count = header.getUint32(0, true);
  const expected = HEADER_BYTES + COLUMN_BYTES * count;
  if (buffer.byteLength !== expected) {
    throw new RangeError(`belief of ${buffer.byteLength} bytes; ${count} columns take ${expected}`);
  }
  let offset = HEADER_BYTES;
  const take = (bytes: number) => {
    const at = offset;
    offset += bytes * count;
    return at;
  };
  const belief = {
    stamp_ns: header.getBigInt64(4, true).toString(),
    count,
    cell_size_m: header.getFloat32(12, true),
    west: header.getFloat32(16, true),
    south: header.getFloat32(20, true),
    columns: new Uint16Array(buffer, take(2), count),
    rows: new Uint16Array(buffer, take(2), count),
    up_m: new Float32Array(buffer, take(4), count),
    probability: new Uint8Array(buffer, take(1), count),
    state: new Uint8Array(buffer, take(1), count),
    age: new Uint16Array(buffer, take(2), count),
  };
  if (belief.state.some((state) => state > VoxelState.notCleared)) throw new RangeError("belief of an unknown state");
  return belief;
}

/** How old a look is; Infinity for what is older than can be told. */
export const lookAge_s = (belief: Belief, k: number, older_s: number) => (belief.age[k] === OLDER_THAN_KNOWN ? Infinity : belief.age[k] / 10 + older_s);

/** A state as of a later time: that ground is empty holds for a while only. */
export function agedState(state: VoxelState, age_s: number, stale_after_s: number): VoxelState {
  return state === VoxelState.empty && age_s > stale_after_s ? VoxelState.stale : state;
}

/** As of when a belief is read. */
export interface Reading {
  /** Beyond the ages in it. */
  older_s: number;
  stale_after_s: number;
}

export interface Ground {
  state: VoxelState;
  /** None where nobody has looked: the lack of a look is not a probability. */
  probability: number | null;
  age_s: number | null;
}

/** Column and row -> entry, made once per belief and only when somebody asks. */
export class BeliefIndex {
  private readonly entries = new Map<number, number>();

  constructor(readonly belief: Belief) {
    for (let k = 0; k < belief.count; k++) this.entries.set((belief.rows[k] << 16) | belief.columns[k], k);
  }

  at(east: number, north: number, { older_s, stale_after_s }: Reading): Ground {
    const { belief } = this;
    const column = Math.floor((east - belief.west) / belief.cell_size_m);
    const row = Math.floor((north - belief.south) / belief.cell_size_m);
    const inside = column >= 0 && row >= 0 && column < 65_536 && row < 65_536;
    const k = inside ? this.entries.get((row << 16) | column) : undefined;
    const age = k === undefined ? Infinity : lookAge_s(belief, k, older_s);
    const state = k === undefined ? VoxelState.neverSeen : agedState(belief.state[k], age, stale_after_s);
    const known = k !== undefined && state !== VoxelState.neverSeen && state !== VoxelState.occluded;
    return {
      state,
      probability: known ? belief.probability[k] / 255 : null,
      age_s: known && age < Infinity ? age : null,
    };
  }
}

/** Square metres of each state; never seen is what no entry names and is not counted here. */
export function areaByState(belief: Belief, { older_s, stale_after_s }: Reading): number[] {
  const counts = new Array<number>(6).fill(0);
  belief.state.forEach((state, k) => counts[agedState(state, lookAge_s(belief, k, older_s), stale_after_s)]++);
  return counts.map((count) => count * belief.cell_size_m ** 2);
}
