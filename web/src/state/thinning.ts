// A page that is open for days keeps a time line of bounded length.

export const MOST_POINTS = 4000;

/** Every second point of the older half once there are more than `most`; the newest stay as they are. */
export function thinned<T>(points: readonly T[], most = MOST_POINTS): readonly T[] {
  if (points.length <= most) return points;
  const half = points.length >> 1;
  return points.filter((_, k) => k >= half || k % 2 === 0);
}
