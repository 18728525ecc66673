import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { formatLink, parseLink } from "../src/state/deep_link";
import { notify } from "../src/state/session";
import { EMPTY_STATE, store, Store } from "../src/state/store";
import type { Alert, AlertLevel } from "../src/api/contract";
import { byUrgency, isOpen, marks, subjectOf, withAlert } from "../src/state/alerts";
import { elapsed_ms } from "../src/state/elapsed";
import { pauseOf } from "../src/state/pace";
import { thinned } from "../src/state/thinning";
import type { Drone } from "../src/api/contract";
import { agedDrones, behind_s, now_ms, older_s, pointAt, silence_s, sinceFirst } from "../src/state/time";

describe("links", () => {
  it("lead back to where they were made", () => {
    const view = { target: [-512.3, 81.5, 1204.1] as [number, number, number], zoom: 1.25, rotationX: 48, rotationOrbit: -28.5 };
    for (const selection of [null, { kind: "zone", id: "Z1" }, { kind: "drone", id: "uav 1&2" }, { kind: "ground", east: 1.5, north: -2 }] as const) {
      const link = { t: "1767225600095371891", selection, view };
      expect(parseLink(formatLink(link))).toEqual(link);
    }
  });

  it("of the newest moment with nothing selected are empty", () => {
    expect(formatLink({ t: null, selection: null, view: null })).toBe("");
    expect(parseLink("")).toEqual({ t: null, selection: null, view: null });
  });

  it.each(["#t=abc", "#t=-5", "#t=99999999999999999999", "#view=1,2,3", "#view=1,2,3,4,5,x", "#at=1", "#view=,,,,,"])(
    "with nonsense are no links: %s",
    (hash) => expect(parseLink(hash)).toEqual({ t: null, selection: null, view: null }),
  );
});

describe("cameras", () => {
  it("leave three pages of one operator room for what is decided, however many drones fly", () => {
    for (const drones of [1, 5, 12, 24, 48, 200]) {
      const asked_per_s = (2 * (drones + 1) * 1000) / pauseOf(drones + 1); // and the large one in the card
      expect(3 * asked_per_s).toBeLessThan(100 - 3 * 5);
    }
    expect(pauseOf(3)).toBe(400);
  });
});

describe("a long time line", () => {
  it("loses none of its newer half and neither end", () => {
    const points = [...Array(11).keys()];
    expect(thinned(points, 10)).toEqual([0, 2, 4, 5, 6, 7, 8, 9, 10]);
    expect(thinned(points, 11)).toBe(points);
  });

  it("stays bounded however long it grows", () => {
    let points: readonly number[] = [];
    for (let k = 0; k < 1000; k++) {
      points = thinned([...points, k], 40);
      expect(points.length).toBeLessThanOrEqual(41);
    }
    expect(points[0]).toBe(0);
    expect(points.slice(-10)).toEqual([990, 991, 992, 993, 994, 995, 996, 997, 998, 999]);
  });
});

describe("a moment that a long time line steps over", () => {
  const point = (stamp_ns: string, closed_m2: number) => ({ stamp_ns, stamp_ms: Number(stamp_ns) / 1e6, seen_m2: 0, crowd_m2: 0, closed_m2, zones: 0 });
  const points = [point("1767225600000000000", 0), point("1767225614000000000", 500)];

  it("is asked for by its own stamp: at the point before it what happened then had not happened yet", () => {
    expect(sinceFirst(points, "1767225605000000001")).toBe("1767225605000000001");
    expect(sinceFirst(points, "900000000000000000")).toBe("1767225600000000000");
    expect(sinceFirst([], "900000000000000000")).toBe("900000000000000000");
  });

  it("has no figures rather than those of another", () => {
    expect(pointAt(points, "1767225614000000000")?.closed_m2).toBe(500);
    expect(pointAt(points, "1767225605000000001")).toBeNull();
  });
});

describe("now", () => {
  beforeEach(() => void vi.useFakeTimers());
  afterEach(() => void vi.useRealTimers());

  it("is the time of the service while views arrive, so that what comes late does not look new", () => {
    const moment = { stamp_ms: 10_000, lag_s: 7, arrived: elapsed_ms() - 200 } as unknown as (typeof EMPTY_STATE)["moment"];
    const live = { ...EMPTY_STATE, moment, mode: "live" as const, time: { ...EMPTY_STATE.time, following: true } };
    expect(now_ms(live)).toBe(10_000 + 7_000 + 200);
    expect(behind_s(live)).toBe(7);
    const past = { ...live, time: { ...live.time, following: false } };
    expect(now_ms(past)).toBe(10_000);
    expect(behind_s(past)).toBe(0);
    expect(now_ms({ ...live, mode: "replay" })).toBe(10_000);
  });

  describe("in silence", () => {
    const drone = (name: string, age_s: number | null, status: Drone["status"]) => ({ drone: name, age_s, status }) as Drone;
    const moment = { stamp_ms: 10_000, lag_s: 55, silent_s: 54, arrived: 0, drones: [drone("a", 1, "ok"), drone("b", 4, "ok"), drone("c", null, "never")] };
    const scene = { silent_after_s: 5, zone_rules: { stale_after_s: 30 } };
    const belief = { stamp_ns: "64000000000" };
    const live = { ...EMPTY_STATE, mode: "live", moment, scene, belief } as unknown as typeof EMPTY_STATE;
    beforeEach(() => void (moment.arrived = elapsed_ms()));

    it("counts what was silent before the page was opened", () => {
      expect(silence_s(live)).toBe(54);
      vi.advanceTimersByTime(2000);
      expect(silence_s(live)).toBe(56);
      expect(silence_s({ ...live, mode: "replay" })).toBe(0);
      expect(silence_s({ ...live, time: { ...live.time, following: false } })).toBe(0);
    });

    it("lets the map of the ground grow old, and never young", () => {
      expect(older_s(live)).toBe(1);
      vi.advanceTimersByTime(2000);
      expect(older_s(live)).toBe(3);
      expect(older_s({ ...live, time: { ...live.time, following: false } })).toBe(0);
    });

    it("marks a drone as silent by its age, though no message says so", () => {
      expect(agedDrones(live)).toBeNull();
      vi.advanceTimersByTime(2000);
      expect(agedDrones(live)?.map(({ status }) => status)).toEqual(["ok", "stale", "never"]);
      vi.advanceTimersByTime(58_000);
      expect(agedDrones(live)?.map(({ status }) => status)).toEqual(["stale", "stale", "never"]);
      expect(agedDrones({ ...live, mode: "replay" })).toBeNull();
    });

    it("goes on while the machine sleeps, which stops the page's clock alone", () => {
      vi.setSystemTime(Date.now() + 3_600_000);
      expect(silence_s(live)).toBe(54 + 3600);
      expect(older_s(live)).toBe(1 + 3600);
      expect(now_ms(live)).toBe(10_000 + 55_000 + 3_600_000);
      expect(agedDrones(live)?.map(({ status }) => status)).toEqual(["stale", "stale", "never"]);
      vi.setSystemTime(Date.now() - 7_200_000); // a clock that is set back makes nothing young
      expect(silence_s(live)).toBe(54 + 3600);
      vi.advanceTimersByTime(1000);
      expect(silence_s(live)).toBe(54 + 3601);
    });
  });
});

describe("alerts", () => {
  const alert = (id: string, level: AlertLevel, over: boolean, seen: boolean): Alert => ({
    ...{ id, level, kind: "drone_near_zone", text: id, drone: "uav1", zone: "Z1", raised_ns: "1000000", raised_ms: 1 },
    ...{ cleared_ms: over ? 2 : null, acknowledged_by: seen ? "ana" : null, acknowledged_ms: seen ? 3 : null },
  });

  it("need somebody: an alarm until it was seen, a warning while it holds, news never", () => {
    expect(isOpen(alert("a", "alarm", true, false))).toBe(true);
    expect(isOpen(alert("b", "alarm", false, true))).toBe(false);
    expect(isOpen(alert("c", "warning", false, false))).toBe(true);
    expect(isOpen(alert("d", "warning", true, false))).toBe(false);
    expect(isOpen(alert("e", "info", false, false))).toBe(false);
  });

  it("stay bounded on a page that is open for days, and those that need somebody stay", () => {
    const at = (id: string, raised_ms: number, level: AlertLevel, over: boolean) => ({ ...alert(id, level, over, false), raised_ms });
    let told: Alert[] = [];
    for (let k = 0; k < 500; k++) told = withAlert(told, at(`A${k}`, k, k % 100 ? "info" : "alarm", true), 20);
    expect(told.map(({ id }) => id)).toEqual([
      ...Array.from({ length: 15 }, (_, k) => `A${499 - k}`),
      ...["A400", "A300", "A200", "A100", "A0"], // alarms that nobody has seen
    ]);
    const seen = { ...told[19], acknowledged_by: "ana" };
    expect(withAlert(told, seen, 20).map(({ id }) => id)).toEqual(told.map(({ id }) => id));
  });

  it("stand in the order in which somebody is needed, and else in their own", () => {
    const told = [alert("news", "info", false, false), alert("seen", "alarm", false, true), alert("near", "warning", false, false), alert("inside", "alarm", true, false)];
    expect(byUrgency(told).map(({ id }) => id)).toEqual(["inside", "near", "news", "seen"]);
  });

  it("show what they are about: a zone, else a drone, and nothing where nobody read which drone it was", () => {
    const about = (drone: string | null, zone: string | null) => subjectOf({ ...alert("a", "warning", false, false), drone, zone });
    expect(about("uav1", "Z1")).toEqual({ kind: "zone", id: "Z1" });
    expect(about("uav1", null)).toEqual({ kind: "drone", id: "uav1" });
    expect(about("(unknown)", null)).toBeNull();
    expect(about(null, null)).toBeNull();
  });

  it("leave one mark where many would cover each other: the most urgent", () => {
    const at = ({ id }: Alert) => Number(id);
    const told = [alert("0.500", "info", false, false), alert("0.505", "alarm", false, false), alert("0.511", "warning", false, false), alert("0.53", "info", false, false)];
    expect(marks(told, at, 0.012).map(({ id }) => id)).toEqual(["0.505", "0.53"]);
    const crowded = Array.from({ length: 1000 }, (_, k) => alert(String(k / 1000), "info", false, false));
    expect(marks(crowded, at, 0.012).length).toBeLessThanOrEqual(84);
  });
});

describe("the store", () => {
  it("tells everybody who listens, and nobody who has left", () => {
    const store = new Store();
    const heard: string[] = [];
    const leave = store.subscribe((state) => heard.push(state.units));
    store.set({ units: "feet" });
    leave();
    store.set({ units: "metres" });
    expect(heard).toEqual(["feet"]);
    expect(store.state).toEqual(EMPTY_STATE);
  });
});

describe("notices", () => {
  it("that are equal are one, and stay as long as the last of them", () => {
    vi.useFakeTimers();
    vi.stubGlobal("window", globalThis);
    const texts = () => store.state.notices.map(({ text }) => text);
    for (let k = 0; k < 4; k++) {
      notify("The service does not answer.", "error");
      vi.advanceTimersByTime(3000);
    }
    notify("Z1 is locked.");
    expect(texts()).toEqual(["The service does not answer.", "Z1 is locked."]);
    vi.advanceTimersByTime(5_990); // 9 s after the last of them
    expect(texts()).toEqual(["The service does not answer."]);
    vi.advanceTimersByTime(20);
    expect(texts()).toEqual([]);
    vi.useRealTimers();
    vi.unstubAllGlobals();
  });
});
