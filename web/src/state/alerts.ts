// Which alerts somebody has to look at, and which of their marks fit on a line.

import type { Alert, AlertLevel } from "../api/contract";

const URGENCY: Record<AlertLevel, number> = { alarm: 0, warning: 1, info: 2 };

/** An alarm until somebody saw it; a warning no longer than it holds. */
export function isOpen({ level, acknowledged_by, cleared_ms }: Alert): boolean {
  return acknowledged_by === null && (level === "alarm" || (level === "warning" && cleared_ms === null));
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
