import { describe, expect, it } from "vitest";
import type { Zone } from "../src/api/contract";
import { byWeight, labelOffsets, type Box } from "../src/map/label_places";

const label = (x: number, y: number): Box => ({ x, y, width: 60, height: 20 });
const marker = (x: number, y: number): Box => ({ x, y, width: 18, height: 18 });

describe("labels", () => {
  it("stand at their places where there is room", () => {
    expect(labelOffsets([label(0, 0), label(63, 0), label(0, 23)], [marker(0, -25)])).toEqual([[0, 0], [0, 0], [0, 0]]);
  });

  it("give way to those before them", () => {
    const [first, second] = labelOffsets([label(0, 0), label(10, 5)], []);
    expect(first).toEqual([0, 0]);
    expect(second).toEqual([0, 36]);
  });

  it("give way to markers, but are not left out for them", () => {
    expect(labelOffsets([label(0, 0)], [marker(0, 0)])).toEqual([[0, 36]]);
    const everywhere = Array.from({ length: 400 }, (_, k) => marker(-190 + 20 * (k % 20), -190 + 20 * Math.floor(k / 20)));
    expect(labelOffsets([label(0, 0)], everywhere)).toEqual([[0, 0]]);
  });

  it("of many at one place cover none, and the last are left out", () => {
    const crowded = Array.from({ length: 40 }, (_, k) => label(k % 7, k % 5));
    const offsets = labelOffsets(crowded, []);
    expect(offsets[0]).toEqual([0, 0]);
    expect(offsets).toContain(null);
    const shown = crowded.flatMap(({ x, y }, k) => (offsets[k] ? [[x + offsets[k][0], y + offsets[k][1]]] : []));
    for (const [k, [x, y]] of shown.entries())
      for (const [u, v] of shown.slice(0, k)) expect(Math.abs(x - u) >= 60 || Math.abs(y - v) >= 20).toBe(true);
  });

  it("of the surest crowd come first, of ground that is closed for another reason last", () => {
    const zone = (id: string, kind: Zone["kind"], probability_max: number | null, closed_m2: number) => ({ id, kind, probability_max, closed_m2 }) as Zone;
    const zones = [zone("UNSEEN", "unseen", null, 9e5), zone("small", "crowd", 0.4, 5), zone("large", "crowd", 0.4, 50), zone("sure", "crowd", 0.9, 1)];
    expect(byWeight(zones).map(({ id }) => id)).toEqual(["sure", "large", "small", "UNSEEN"]);
    expect(zones[0].id).toBe("UNSEEN");
  });
});
