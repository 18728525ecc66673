// Which labels of the map are shown, and where: none covers another, and what matters more keeps its own.

import type { Zone } from "../api/contract";

/** On the screen, by its middle. */
export interface Box {
  x: number;
  y: number;
  width: number;
  height: number;
}

export type Offset = readonly [right: number, down: number];

/** Its own place first. */
const BESIDE: readonly Offset[] = [[0, 0], [0, -12], [0, 36], [0, -24], [60, 0], [-60, 0], [60, -24], [-60, -24], [60, 36], [-60, 36], [0, 48], [0, -48]];
const GAP = 2;

const moved = (box: Box, [right, down]: Offset): Box => ({ ...box, x: box.x + right, y: box.y + down });
const covers = (one: Box, [right, down]: Offset, other: Box) =>
  Math.abs(one.x + right - other.x) < (one.width + other.width) / 2 + GAP && Math.abs(one.y + down - other.y) < (one.height + other.height) / 2 + GAP;

/** How far each label stands from its place, null where it has no room: earlier ones choose first. Where all room beside
 * the markers is taken, a label covers a marker rather than be left out. */
export function labelOffsets(labels: readonly Box[], markers: readonly Box[]): (Offset | null)[] {
  const taken: Box[] = [];
  return labels.map((label) => {
    const besides = (others: readonly Box[]) => (offset: Offset) => !others.some((other) => covers(label, offset, other));
    const [free, clear] = [besides(taken), besides(markers)];
    const offset = BESIDE.find((one) => clear(one) && free(one)) ?? BESIDE.find(free) ?? null;
    if (offset) taken.push(moved(label, offset));
    return offset;
  });
}

/** Crowds before other ground, the surest first; of equals the larger. */
export function byWeight(zones: readonly Zone[]): Zone[] {
  const other = (zone: Zone) => Number(zone.kind !== "crowd");
  const surely = (zone: Zone) => zone.probability_max ?? 0;
  return [...zones].sort((a, b) => other(a) - other(b) || surely(b) - surely(a) || b.closed_m2 - a.closed_m2);
}
