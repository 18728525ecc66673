// What time it is for what is shown, and what time does to it while the service says nothing.

import type { Drone, TimelinePoint } from "../api/contract";
import { compareStamps } from "../text/stamp";
import { elapsed_ms } from "./elapsed";
import type { State } from "./store";

/** Without a view for longer, the page is not live. */
export const LATE_S = 4;

/** Whether the moment shown is the newest of a service that takes in views. */
const isLive = ({ moment, time, mode }: State) => moment !== null && time.following && mode === "live";

/** Seconds since the newest moment arrived; 0 for moments that do not age. */
const since_s = (state: State) => (isLive(state) ? (elapsed_ms() - state.moment!.arrived) / 1000 : 0);

/** "Now" for ages and count-downs: the stamp of what is shown; the time of the service while the page follows live data. */
export function now_ms(state: State): number {
  const { moment } = state;
  if (!moment) return 0;
  return moment.stamp_ms + (isLive(state) ? 1000 * ((moment.lag_s ?? 0) + since_s(state)) : 0);
}

/** How old the newest moment was when it arrived: views that wait in the service make the map late. */
export function behind_s(state: State): number {
  return isLive(state) ? (state.moment!.lag_s ?? 0) : 0;
}

/** Seconds without a view, also those before the page was opened; only live data can be late. */
export function silence_s(state: State): number {
  return isLive(state) ? (state.moment!.silent_s ?? 0) + since_s(state) : 0;
}

/** By how much the map of the ground is older than now: its own ages are as of its stamp. */
export function older_s(state: State): number {
  if (!state.belief || !state.moment) return 0;
  return Math.max((now_ms(state) - Number(BigInt(state.belief.stamp_ns) / 1_000_000n)) / 1000, 0);
}

export function staleAfter_s({ scene }: State): number {
  return Number(scene?.zone_rules.stale_after_s) || 30;
}

/** The drones whose status time has changed since the moment arrived among the others; null where it has changed none. */
export function agedDrones(state: State): Drone[] | null {
  const { moment, scene } = state;
  if (!moment || !scene) return null;
  const passed_s = since_s(state);
  const isSilent = ({ status, age_s }: Drone) => status === "ok" && age_s !== null && age_s + passed_s > scene.silent_after_s;
  if (!moment.drones.some(isSilent)) return null;
  return moment.drones.map((drone) => (isSilent(drone) ? { ...drone, status: "stale" } : drone));
}

/** A stamp as it can be asked for: nothing is known before the first point. The points of a long mission are seconds
 * apart, and what happened at a stamp had not happened yet at the point before it. */
export function sinceFirst(points: readonly TimelinePoint[], stamp_ns: string): string {
  return points.length && compareStamps(stamp_ns, points[0].stamp_ns) < 0 ? points[0].stamp_ns : stamp_ns;
}

/** The figures of a moment; null where the time line steps over it: those of another one are not its own. */
export function pointAt(points: readonly TimelinePoint[], stamp_ns: string): TimelinePoint | null {
  return points.findLast((point) => point.stamp_ns === stamp_ns) ?? null;
}
