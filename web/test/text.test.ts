import { describe, expect, it } from "vitest";
import type { Zone } from "../src/api/contract";
import { waitBefore } from "../src/api/stream";
import { closureOf } from "../src/text/closure";
import { exportCommand, FORMATS } from "../src/text/exports";
import { ago, compareStamps, dayAndTime, duration, endOf, indexAt, timeOfDay, withTimes } from "../src/text/stamp";
import { area, degrees, grouped, heights, length, place, probability } from "../src/text/units";
import { openWords } from "../src/text/words";
import { VoxelState } from "../src/map/belief";
import { roundLength } from "../src/ui/scale_bar";

describe("stamps", () => {
  it("are compared as numbers, exactly", () => {
    expect(compareStamps("999", "1000")).toBe(-1);
    expect(compareStamps("1767225600095371892", "1767225600095371891")).toBe(1); // one number as doubles
    expect(compareStamps("0", "0")).toBe(0);
  });

  it("are shortened where a sentence names them", () => {
    const told = (today: string) => withTimes("the last of 2026-11-22T18:40:00.394079279Z: zones stay", "utc", Date.parse(today));
    expect(told("2026-11-22T23:59:59.999Z")).toBe("the last of 18:40:00 UTC: zones stay");
    expect(told("2026-11-23T00:00:00Z")).toBe("the last of 2026-11-22 18:40:00 UTC: zones stay");
    expect(withTimes("uav1 is in zone Z1", "utc", 0)).toBe("uav1 is in zone Z1");
  });

  it("have their date on another day, which begins at the midnight of the clock", () => {
    const stamp = new Date(2026, 10, 22, 23, 59, 30).getTime(); // on the clock of this machine
    expect(dayAndTime(stamp, "local", stamp + 20_000, 0)).toBe("23:59:30");
    expect(dayAndTime(stamp, "local", stamp + 40_000, 0)).toBe("2026-11-22 23:59:30");
  });

  it("lead to the last point before them", () => {
    const points = [10, 20, 30].map((stamp_ms) => ({ stamp_ms }));
    expect([5, 10, 19.9, 20, 99].map((stamp) => indexAt(points, stamp))).toEqual([0, 0, 0, 1, 2]);
  });

  it("are read on a clock", () => {
    const stamp = Date.UTC(2026, 0, 1, 12, 41, 7, 345);
    expect(timeOfDay(stamp, "utc")).toBe("12:41:07.3");
    expect(timeOfDay(stamp, "utc", 0)).toBe("12:41:07");
    const local = new Date(stamp);
    expect(timeOfDay(stamp, "local", 0)).toBe([local.getHours(), local.getMinutes(), local.getSeconds()].map((part) => String(part).padStart(2, "0")).join(":"));
  });

  it.each([
    [0.04, "0.0 s"],
    [9.94, "9.9 s"],
    [9.96, "10 s"],
    [61, "61 s"],
    [185, "3 min 05 s"],
    [3599.6, "1 h 00 min"],
    [7800, "2 h 10 min"],
    [200_000, "2 days"],
  ])("%d s is %s", (seconds, text) => expect(duration(seconds)).toBe(text));

  it("say how long ago", () => {
    expect(ago(null, 5)).toBe("never");
    expect(ago(1000, 1020)).toBe("just now");
    expect(ago(1000, 4000)).toBe("3.0 s ago");
  });
});

describe("the end of a zone", () => {
  it("is a look where the method knows no end", () => {
    expect(endOf(null, 0)).toEqual({ text: "until looked at", counts: false });
  });
  it("counts down, and is never open before the service says so", () => {
    expect(endOf(12_000, 0).text).toBe("12 s");
    expect(endOf(12_000, 99_000)).toEqual({ text: "end is due", counts: true });
  });
});

describe("why a zone is closed", () => {
  const zone = { kind: "crowd", reason: "not_looked_at", locked: false, valid_until_ms: null } as unknown as Zone;

  it("is what drones saw", () => {
    const { opens, end } = closureOf(zone, 0);
    expect(opens).toMatch(/Time alone does not open it/);
    expect(end).toBe("until looked at");
  });

  it("is what they saw at the last look, once no view has come for a while", () => {
    const seen = { ...zone, reason: "seen", why: "a drone saw crowd in it at this instant", last_seen_ms: 10_000 };
    expect(closureOf(seen, 13_900)).toMatchObject({ reason: "crowd in view", why: seen.why });
    expect(closureOf(seen, 22_000)).toMatchObject({ reason: "no look since", why: "a drone saw crowd in it 12 s ago" });
    expect(closureOf(seen, 22_000).opens).toMatch(/Time alone does not open it/);
    expect(closureOf({ ...seen, locked: true }, 22_000).end).toBe("until unlocked");
  });

  it("is an operator's word before all", () => {
    expect(closureOf({ ...zone, locked: true }, 0).end).toBe("until unlocked");
    expect(closureOf({ ...zone, kind: "operator", reason: "given" }, 0).end).toBe("until dismissed");
    expect(closureOf({ ...zone, kind: "static", reason: "given" }, 0).end).toBe("until taken back");
  });

  it("has words for every code of the service", () => {
    for (const reason of ["seen", "not_cleared", "not_looked_at", "held", "never_cleared", "given"]) {
      expect(closureOf({ ...zone, reason }, 0).opens).toMatch(/^It opens/);
    }
  });
});

describe("units", () => {
  it("are metres or feet", () => {
    expect(length(30.48, "feet")).toBe("100 ft");
    expect(length(30.48, "metres", 1)).toBe("30.5 m");
    expect(area(9.290304, "feet")).toBe("100 ft²");
    expect(area(4.25, "metres")).toBe("4.3 m²");
    expect(area(0, "metres")).toBe("0 m²");
    expect([0.04, 0.25, 0.3].map((value) => area(value, "metres"))).toEqual(["0.04 m²", "0.25 m²", "0.3 m²"]);
  });

  it("say where a zone has no upper end", () => {
    expect(heights({ lower_m: 0, upper_m: 120, datum: "AGL" }, "metres")).toBe("0 m to 120 m AGL");
    expect(heights({ lower_m: 30.48, upper_m: 99_999, datum: "AGL" }, "feet")).toBe("from 100 ft AGL up, without a ceiling");
  });

  it("group digits", () => {
    expect(grouped(1_234_567)).toBe("1\u2009234\u2009567");
    expect(grouped(-1234.56, 1)).toBe("−1\u2009234.6");
    expect(grouped(999.99, 1)).toBe("1\u2009000.0");
    expect(grouped(-0.2)).toBe("0");
  });

  it("never round a probability to certainty", () => {
    expect([0, 0.0004, 0.0689, 0.5, 0.9996, 1].map(probability)).toEqual(["0.000", "< 0.001", "0.069", "0.50", "> 0.999", "1.00"]);
    expect(probability(null)).toBe("not known");
  });

  it("give places in degrees where there are any", () => {
    const anchor = { latitude_deg: 46.5, longitude_deg: 8, height_m: 1200 };
    expect(place(1000, 1000, anchor, "metres")).toBe("46.50899° N 8.01303° E"); // as in earth.test.ts
    expect(degrees(-33.5, -70.25)).toBe("33.50000° S 70.25000° W");
    expect(degrees(-16.8, 180.0125)).toBe("16.80000° S 179.98750° W"); // Taveuni, seen from the west
    expect(degrees(-16.8, -180.0125)).toBe("16.80000° S 179.98750° E");
    expect(place(12, -7, null, "metres")).toBe("E 12 m  N −7 m");
  });

  it("fit a scale bar", () => expect([0.7, 1, 4.9, 5, 73].map(roundLength)).toEqual([0.5, 1, 2, 5, 50]));
});

describe("exports", () => {
  it("have the command that makes the same file", () => {
    expect(exportCommand("ed318", { at: "1767225600095371891", country: "GRC" })).toBe(
      "crowdfence export out/ --format ed318 --at 1767225600095371891 --country GRC -o zones.json",
    );
    expect(new Set(FORMATS.map(({ name }) => name)).size).toBe(FORMATS.length);
  });
});

it("the stream waits longer each time, but not for ever", () => {
  expect([0, 1, 2, 3, 4, 50].map(waitBefore)).toEqual([500, 1000, 2000, 4000, 5000, 5000]);
});

describe("ground in no zone", () => {
  it("is never said to be safe, and crowd says why it is in none", () => {
    expect(openWords(VoxelState.empty)).toBeNull();
    expect(openWords(VoxelState.crowd)).toContain("too little crowd lies together");
    for (const state of [VoxelState.neverSeen, VoxelState.occluded, VoxelState.stale, VoxelState.crowd, VoxelState.notCleared]) {
      expect(openWords(state)).toMatch(/^No zone covers it.* That does not make it safe\.$/);
    }
  });
});
