// The words of the page for the codes of the service.

import { VoxelState } from "../map/belief";
import type { Standing } from "../state/standing";

export const STATE_WORDS: Record<VoxelState, string> = {
  [VoxelState.neverSeen]: "never seen",
  [VoxelState.occluded]: "hidden from view",
  [VoxelState.empty]: "seen, empty",
  [VoxelState.stale]: "seen empty, too long ago",
  [VoxelState.crowd]: "crowd",
  [VoxelState.notCleared]: "looked at, not cleared",
};

export const STATE_MEANING: Record<VoxelState, string> = {
  [VoxelState.neverSeen]: "No view has ever seen this ground. Nothing is known about it.",
  [VoxelState.occluded]: "A camera pointed here and something stood in the way. Nothing is known about it.",
  [VoxelState.empty]: "Seen recently, and what was seen speaks against crowd.",
  [VoxelState.stale]: "Empty when last seen, but that is too long ago to count.",
  [VoxelState.crowd]: "At or above the threshold.",
  [VoxelState.notCleared]: "Looked at, but too far, too coarse or too flat to tell; or crowd was seen and is forgotten. Not known to be empty.",
};

/** Of ground that is in no zone; null where nothing has to be said of that. */
export function openWords(state: VoxelState): string | null {
  if (state === VoxelState.empty) return null;
  const why = state === VoxelState.crowd ? ": too little crowd lies together here" : "";
  return `No zone covers it${why}. That does not make it safe.`;
}

export const KIND_WORDS = {
  crowd: "crowd",
  unseen: "ground not known to be empty",
  static: "given by somebody else",
  operator: "closed by an operator",
} as const;

/** The short form, for lists. */
export const REASON_WORDS: Record<string, string> = {
  seen: "crowd in view",
  not_cleared: "not cleared",
  not_looked_at: "no look since",
  held: "held",
  never_cleared: "not known to be empty",
  given: "given",
  operator: "by an operator",
  locked: "locked",
};

/** What would open the zone: the answer to "why still closed". */
export const OPENS_WHEN: Record<string, string> = {
  seen: "It opens when drones look again and find its ground below the threshold.",
  not_cleared: "It opens when a drone comes close enough to see that nobody is there.",
  not_looked_at: "It opens when a drone looks at this ground and finds it below the threshold. Time alone does not open it.",
  held: "It opens when drones look again and find it below the threshold at which zones end.",
  never_cleared: "It opens when a drone has seen this ground and found it empty.",
  given: "It opens when whoever drew it takes it back.",
  operator: "It opens when an operator dismisses it.",
  locked: "It opens only after an operator unlocks it.",
};

export const EVENT_WORDS: Record<string, string> = {
  created: "appeared",
  split: "came out of",
  merged: "went into",
  expired: "ended",
  updated: "changed",
  locked: "was locked",
  unlocked: "was unlocked",
  dismissed: "was dismissed",
};

export const STANDING_WORDS: Record<Standing, string> = {
  ok: "on time",
  stale: "silent",
  never: "none yet",
  unknown: "not known any more",
  "left-out": "left out",
};
