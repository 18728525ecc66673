// Zones of others, which may be thousands: they come once, and every moment that has the same gets them here.

import type { Zone, Zones } from "../api/contract";

/** Of so many versions: of now, and of a past in which others held. */
const MOST_VERSIONS = 4;

export class StaticZones {
  private readonly held = new Map<string, Zone[]>();

  /** The zones of a moment with those of others; null where they are left out and not held. */
  whole(told: Zones): Zones | null {
    const { static_version: version } = told;
    if (!told.static_left_out) {
      if (version) this.hold(version, told.zones.filter(({ kind }) => kind === "static"));
      return told;
    }
    const others = version ? this.held.get(version) : undefined;
    return others ? { ...told, static_left_out: false, zones: [...told.zones, ...others] } : null;
  }

  private hold(version: string, zones: Zone[]): void {
    this.held.delete(version);
    this.held.set(version, zones);
    for (const oldest of this.held.keys()) if (this.held.size > MOST_VERSIONS) this.held.delete(oldest);
  }
}
