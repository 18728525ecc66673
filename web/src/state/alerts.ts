// Which alerts somebody has to look at, and which of their marks fit on a line.

import type { Alert, AlertLevel } from "../api/contract";
import type { Selection } from "./store";

const URGENCY: Record<AlertLevel, number> = { alarm: 0, warning: 1, info: 2 };

/** An alarm until somebody saw it; a warning no longer than it holds. */
export function isOpen({ level, acknowledged_by, cleared_ms }: Alert): boolean {
  return acknowledged_by === null && (level === "alarm" || (level === "warning" && cleared_ms === null));
}

/** What the service calls the drone of views that nobody read (`heard.py`). */
const UNKNOWN = "(unknown)";

/** What one is about, on the map; null where that is nothing on it. */
export function subjectOf({ zone, drone }: Alert): Selection {
  if (zone) return { kind: "zone", id: zone };
  return drone && drone !== UNKNOWN ? { kind: "drone", id: drone } : null;
}

/** As many as the service remembers. */
const MOST_ALERTS = 1000;

/** The newest first, with one that is new or has changed; a page that is open for days keeps those that somebody has to look at,
 * and of the others the newest. */
export function withAlert(alerts: readonly Alert[], alert: Alert, most = MOST_ALERTS): Alert[] {
  const all = [alert, ...alerts.filter(({ id }) => id !== alert.id)].sort((a, b) => b.raised_ms - a.raised_ms);
  while (all.length > most) {
    const least = all.findLastIndex((one) => !isOpen(one));
    all.splice(least < 0 ? all.length - 1 : least, 1);
  }
  return all;
}

/** Those that are open first, the most urgent before others. */
export function byUrgency(alerts: readonly Alert[]): Alert[] {
  const rank = (alert: Alert) => (isOpen(alert) ? URGENCY[alert.level] : 3);
  return [...alerts].sort((a, b) => rank(a) - rank(b));
}

/** Of marks nearer than `apart` to one that stays only the most urgent stays; `at` says where one stands. */
export function marks<T extends { level: AlertLevel }>(all: readonly T[], at: (one: T) => number, apart: number): T[] {
  const kept: T[] = [];
  for (const one of [...all].sort((a, b) => URGENCY[a.level] - URGENCY[b.level])) {
    if (kept.every((other) => Math.abs(at(other) - at(one)) >= apart)) kept.push(one);
  }
  return kept;
}
