// Why a zone is closed and how it ends, in the words of the page.

import type { Zone } from "../api/contract";
import { endOf } from "./stamp";
import { KIND_WORDS, OPENS_WHEN, REASON_WORDS } from "./words";

export interface Closure {
  /** For lists. */
  reason: string;
  /** What would open it. */
  opens: string | null;
  /** When it ends. */
  end: string;
  /** Whether that is a count-down. */
  counts: boolean;
}

/** An operator's word goes before what drones see. */
export function closureOf(zone: Zone, now_ms: number): Closure {
  const code = zone.kind === "operator" ? "operator" : zone.locked ? "locked" : (zone.reason ?? "");
  const end = endOf(zone.valid_until_ms, now_ms);
  const held = code === "operator" || code === "given" || code === "locked";
  return {
    reason: zone.dismissed ? "dismissed for now" : (REASON_WORDS[code] ?? KIND_WORDS[zone.kind]),
    opens: OPENS_WHEN[code] ?? null,
    end: held && !end.counts ? UNTIL[code] : end.text,
    counts: end.counts,
  };
}

const UNTIL: Record<string, string> = {
  operator: "until dismissed",
  locked: "until unlocked",
  given: "until taken back",
};
