// Why a zone is closed and how it ends, in the words of the page.

import type { Zone } from "../api/contract";
import { LATE_S } from "../state/time";
import { ago, endOf } from "./stamp";
import { KIND_WORDS, OPENS_WHEN, REASON_WORDS } from "./words";

export interface Closure {
  /** For lists. */
  reason: string;
  /** As a sentence, by the service. */
  why: string;
  /** What would open it. */
  opens: string | null;
  /** When it ends. */
  end: string;
  /** Whether that is a count-down. */
  counts: boolean;
}

/** What drones saw "at this instant"; once no view has come for a while, that is no longer the one shown. */
const OF_ITS_INSTANT = ["seen", "not_cleared"];

/** An operator's word goes before what drones see. */
export function closureOf(zone: Zone, now_ms: number): Closure {
  const { reason, last_seen_ms } = zone;
  const isOver = OF_ITS_INSTANT.includes(reason ?? "") && last_seen_ms !== null && now_ms - last_seen_ms > 1000 * LATE_S;
  const seen = isOver ? "not_looked_at" : (reason ?? "");
  const code = zone.kind === "operator" ? "operator" : zone.locked ? "locked" : seen;
  const end = endOf(zone.valid_until_ms, now_ms);
  const held = code === "operator" || code === "given" || code === "locked";
  return {
    reason: zone.dismissed ? "dismissed for now" : (REASON_WORDS[code] ?? KIND_WORDS[zone.kind]),
    why: isOver ? (zone.why ?? "").replace("at this instant", ago(last_seen_ms, now_ms)) : (zone.why ?? ""),
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
