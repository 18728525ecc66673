import { describe, expect, it } from "vitest";
import { areaByState, BeliefIndex, parseBelief, VoxelState } from "../src/map/belief";

interface Column {
  column: number;
  row: number;
  up: number;
  probability: number;
  state: number;
  age: number;
}

/** As the service packs it, written byte by byte. */
function packed(columns: Column[], stamp = 1_767_225_600_095_371_891n): ArrayBuffer {
  const n = columns.length;
  const buffer = new ArrayBuffer(24 + 12 * n);
  const view = new DataView(buffer);
  view.setUint32(0, n, true);
  view.setBigInt64(4, stamp, true);
  view.setFloat32(12, 0.5, true);
  view.setFloat32(16, -100, true);
  view.setFloat32(20, 40, true);
  columns.forEach((one, k) => {
    view.setUint16(24 + 2 * k, one.column, true);
    view.setUint16(24 + 2 * n + 2 * k, one.row, true);
    view.setFloat32(24 + 4 * n + 4 * k, one.up, true);
    view.setUint8(24 + 8 * n + k, one.probability);
    view.setUint8(24 + 9 * n + k, one.state);
    view.setUint16(24 + 10 * n + 2 * k, one.age, true);
  });
  return buffer;
}

const CROWD = { column: 3, row: 1, up: 12.5, probability: 255, state: VoxelState.crowd, age: 4 };
const HIDDEN = { column: 700, row: 65_535, up: -3, probability: 0, state: VoxelState.occluded, age: 65_535 };
const EMPTY = { column: 0, row: 0, up: 0, probability: 51, state: VoxelState.empty, age: 65_535 };

describe("the belief as the service packs it", () => {
  it("keeps every field of an odd number of columns", () => {
    const belief = parseBelief(packed([CROWD, HIDDEN, EMPTY]));
    expect(belief.stamp_ns).toBe("1767225600095371891"); // more than a number can hold
    expect([belief.cell_size_m, belief.west, belief.south]).toEqual([0.5, -100, 40]);
    expect([...belief.columns]).toEqual([3, 700, 0]);
    expect([...belief.rows]).toEqual([1, 65_535, 0]);
    expect([...belief.up_m]).toEqual([12.5, -3, 0]);
    expect([...belief.state]).toEqual([VoxelState.crowd, VoxelState.occluded, VoxelState.empty]);
    expect([...belief.age]).toEqual([4, 65_535, 65_535]);
  });

  it("may hold nothing", () => expect(parseBelief(packed([])).count).toBe(0));

  it.each([0, 10, 23, 24 + 12, 24 + 23, 24 + 36])("refuses %i bytes that are no whole belief of two", (bytes) => {
    const longer = new Uint8Array(200);
    longer.set(new Uint8Array(packed([CROWD, EMPTY])));
    expect(() => parseBelief(longer.buffer.slice(0, bytes))).toThrow(RangeError);
  });

  it("refuses a state that it does not know", () => {
    expect(() => parseBelief(packed([{ ...CROWD, state: 6 }]))).toThrow(/state/);
  });
});

const NOW = { older_s: 0, stale_after_s: 30 };
const LATER = { older_s: 31, stale_after_s: 30 };

describe("what is known of a spot", () => {
  const index = new BeliefIndex(parseBelief(packed([CROWD, HIDDEN, EMPTY])));

  it("finds the column that holds it", () => {
    // Column 3 of half metres from -100 covers [-98.5, -98), row 1 from 40 covers [40.5, 41).
    expect(index.at(-98.5, 40.5, NOW)).toEqual({ state: VoxelState.crowd, probability: 1, age_s: 0.4 });
    expect(index.at(-98.01, 40.99, NOW).state).toBe(VoxelState.crowd);
    expect(index.at(-98, 40.5, NOW).state).toBe(VoxelState.neverSeen);
  });

  it("never takes the lack of a look for a probability", () => {
    expect(index.at(5000, 5000, NOW)).toEqual({ state: VoxelState.neverSeen, probability: null, age_s: null });
    expect(index.at(-100.1, 40.1, NOW)).toEqual({ state: VoxelState.neverSeen, probability: null, age_s: null });
    const hidden = index.at(-100 + 350.2, 40 + 65_535 / 2 + 0.2, NOW);
    expect(hidden).toEqual({ state: VoxelState.occluded, probability: null, age_s: null });
  });

  it("gives no age where the look is older than can be said", () => {
    expect(index.at(-99.9, 40.1, NOW)).toEqual({ state: VoxelState.stale, probability: 0.2, age_s: null });
  });

  it("grows old: empty ground turns stale, and crowd stays", () => {
    const seen = new BeliefIndex(parseBelief(packed([CROWD, { ...EMPTY, age: 5 }])));
    expect(seen.at(-99.9, 40.1, NOW)).toEqual({ state: VoxelState.empty, probability: 0.2, age_s: 0.5 });
    expect(seen.at(-99.9, 40.1, { ...NOW, older_s: 29.4 }).state).toBe(VoxelState.empty);
    expect(seen.at(-99.9, 40.1, LATER)).toEqual({ state: VoxelState.stale, probability: 0.2, age_s: 31.5 });
    expect(seen.at(-98.5, 40.5, LATER).state).toBe(VoxelState.crowd);
    expect([VoxelState.empty, VoxelState.stale, VoxelState.crowd].map((state) => areaByState(seen.belief, LATER)[state])).toEqual([0, 0.25, 0.25]);
  });

  it("adds up areas", () => {
    const areas = areaByState(index.belief, NOW);
    expect(areas[VoxelState.crowd]).toBe(0.25);
    expect(areas.reduce((a, b) => a + b)).toBe(0.75);
  });
});
