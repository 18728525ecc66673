// Zones of the moment before for those that are the same in the next one: what was made from them is not made again.

import type { Zone } from "../api/contract";

/** The same zones in the same order; each that is as it was `before`, and each outline, is the object from then. */
export function unchanged(zones: readonly Zone[], before: readonly Zone[]): Zone[] {
  const known = new Map(before.map((zone) => [zone.id, zone]));
  return zones.map((zone) => {
    const old = known.get(zone.id);
    if (!old || old === zone) return zone;
    const polygon = isSame(zone.polygon, old.polygon) ? old.polygon : zone.polygon;
    const crowd_outline = isSame(zone.crowd_outline, old.crowd_outline) ? old.crowd_outline : zone.crowd_outline;
    const shared = { ...zone, polygon, crowd_outline };
    return isSame(shared, old) ? old : shared;
  });
}

/** Of two values as JSON has them. */
function isSame(one: unknown, other: unknown): boolean {
  if (one === other) return true;
  if (typeof one !== "object" || typeof other !== "object" || !one || !other) return false;
  if (Array.isArray(one)) return Array.isArray(other) && one.length === other.length && one.every((value, k) => isSame(value, other[k]));
  const [names, others] = [Object.keys(one), Object.keys(other)];
  return names.length === others.length && names.every((name) => name in other && isSame(one[name as never], other[name as never]));
}
