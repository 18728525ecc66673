import { describe, expect, it } from "vitest";
import type { Zone, Zones } from "../src/api/contract";
import { StaticZones } from "../src/state/static_zones";

const zone = (id: string, kind: Zone["kind"] = "static") => ({ id, kind }) as Zone;
const told = (version: string | null, left_out: boolean, ...zones: Zone[]): Zones => ({
  stamp_ns: "1",
  stamp_ms: 0,
  threshold: 0.5,
  static_version: version,
  static_left_out: left_out,
  zones,
});

describe("zones of others", () => {
  const [crowd, drawn, hospital, school] = [zone("Z1", "crowd"), zone("O1", "operator"), zone("HOSP"), zone("SCHOOL")];

  it("are put to a moment that leaves them out, as the objects from before", () => {
    const zones = new StaticZones();
    expect(zones.whole(told("a", true, crowd))).toBeNull();
    const whole = told("a", false, crowd, drawn, hospital, school);
    expect(zones.whole(whole)).toBe(whole);
    const later = zones.whole(told("a", true, crowd))!;
    expect(later.zones.map(({ id }) => id)).toEqual(["Z1", "HOSP", "SCHOOL"]);
    expect(later.zones[1]).toBe(hospital);
    expect(later.static_left_out).toBe(false);
  });

  it("of another version are asked for", () => {
    const zones = new StaticZones();
    zones.whole(told("a", false, hospital));
    expect(zones.whole(told("b", true, crowd))).toBeNull();
    zones.whole(told("b", false, school));
    expect(zones.whole(told("a", true))!.zones).toEqual([hospital]);
    expect(zones.whole(told("b", true))!.zones).toEqual([school]);
  });

  it("are kept of the last four versions", () => {
    const zones = new StaticZones();
    for (const version of ["a", "b", "c", "d", "a", "e"]) zones.whole(told(version, false, hospital));
    const held = ["a", "b", "c", "d", "e"].filter((version) => zones.whole(told(version, true)));
    expect(held).toEqual(["a", "c", "d", "e"]);
  });

  it("that are none need nothing", () => {
    const none = told(null, false, crowd);
    expect(new StaticZones().whole(none)).toBe(none);
  });
});
