import { describe, expect, it } from "vitest";
import type { Zone } from "../src/api/contract";
import { Kept } from "../src/map/kept";
import { unchanged } from "../src/state/unchanged";

const zone = (id: string, change: Partial<Zone> = {}): Zone =>
  ({ id, name: null, kind: "static", polygon: [[[[0, 0], [4, 0], [4, 3], [0, 0]]]], crowd_outline: null, closed_m2: 6, evidence: [], valid_until_ms: null, ...change }) as Zone;

describe("zones of a new moment", () => {
  it("that are as they were are those from before, in the new order", () => {
    const before = [zone("A"), zone("B")];
    const after = unchanged([zone("B"), zone("new"), zone("A")], before);
    expect(after.map(({ id }) => id)).toEqual(["B", "new", "A"]);
    expect(after[0]).toBe(before[1]);
    expect(after[2]).toBe(before[0]);
  });

  it("that changed say so, and keep an outline that did not", () => {
    const before = [zone("A"), zone("B"), zone("C", { crowd_outline: [[[[1, 1], [2, 1], [2, 2], [1, 1]]]] })];
    const [later, moved, opened] = unchanged(
      [zone("A", { valid_until_ms: 5 }), zone("B", { polygon: [[[[0, 0], [4, 0], [4, 3.0001], [0, 0]]]] }), zone("C", { dismissed: { until_ms: 9 } })],
      before,
    );
    expect(later.valid_until_ms).toBe(5);
    expect(later.polygon).toBe(before[0].polygon);
    expect(moved.polygon[0][0][2]).toEqual([4, 3.0001]);
    expect(opened.crowd_outline).toBeNull();
    expect(opened.dismissed).toEqual({ until_ms: 9 });
  });

  it("lose what they had before and have no more", () => {
    const [now] = unchanged([zone("A")], [zone("A", { dismissed: { until_ms: 9 }, polygon: [] })]);
    expect(now).toEqual(zone("A"));
  });
});

describe("what the map is made of", () => {
  it("is made once from the same things, and again from others", () => {
    const kept = new Kept<number[]>();
    const [one, other] = [{}, {}];
    let made = 0;
    const make = () => [++made];
    const first = kept.of([one, other], make);
    expect(kept.of([one, other], make)).toBe(first);
    expect(kept.of([other, one], make)).toEqual([2]);
    expect(kept.of([other], make)).toEqual([3]);
    expect(kept.of([], make)).toEqual([4]);
  });
});
