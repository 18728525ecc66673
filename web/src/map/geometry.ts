// Outlines in the plane, and lines laid on the ground.

import type { Corner, Outline, Place } from "../api/contract";
import type { Heights } from "./heights";

function insideRing(ring: readonly (readonly number[])[], east: number, north: number): boolean {
  let inside = false;
  for (let i = 0, j = ring.length - 1; i < ring.length; j = i++) {
    const [x, y] = ring[i];
    const [u, v] = ring[j];
    if (y > north !== v > north && east < ((u - x) * (north - y)) / (v - y) + x) inside = !inside;
  }
  return inside;
}

/** In a part and in none of its holes. */
export function contains(outline: Outline, east: number, north: number): boolean {
  return outline.some(
    ([shell, ...holes]) =>
      insideRing(shell, east, north) && !holes.some((hole) => insideRing(hole, east, north)),
  );
}

export type Bounds = [west: number, south: number, east: number, north: number];

export function boundsOf(points: Iterable<readonly number[]>): Bounds | null {
  const bounds: Bounds = [Infinity, Infinity, -Infinity, -Infinity];
  for (const [east, north] of points) {
    bounds[0] = Math.min(bounds[0], east);
    bounds[1] = Math.min(bounds[1], north);
    bounds[2] = Math.max(bounds[2], east);
    bounds[3] = Math.max(bounds[3], north);
  }
  return bounds[0] <= bounds[2] ? bounds : null;
}

/** The ground that points lie on, with room around; the whole map where there are none, or where all lie beside
 * it, as drones do whose poses are of another origin than the map. */
export function groundOf(points: Iterable<readonly number[]>, map: Bounds): Bounds {
  const around = boundsOf(points);
  if (!around) return map;
  const [west, south, east, north] = around;
  if (east < map[0] || west > map[2] || north < map[1] || south > map[3]) return map;
  const margin = 0.12 * Math.max(east - west, north - south, 60);
  return [west - margin, south - margin, east + margin, north + margin];
}

/** What of the bounds lies on the map; null for what lies beside it. */
export function onMap([west, south, east, north]: Bounds, map: Bounds): Bounds | null {
  const shared: Bounds = [Math.max(west, map[0]), Math.max(south, map[1]), Math.min(east, map[2]), Math.min(north, map[3])];
  return shared[0] <= shared[2] && shared[1] <= shared[3] ? shared : null;
}

export function cornersOf(outline: Outline): Corner[] {
  return outline.flat(2);
}

/** Middle of the bounds of its largest part: where its label stands. */
export function middleOf(outline: Outline): Corner {
  let best: Bounds | null = null;
  let size = -1;
  for (const [shell] of outline) {
    const bounds = boundsOf(shell);
    const extent = bounds ? (bounds[2] - bounds[0]) * (bounds[3] - bounds[1]) : -1;
    if (extent > size) [best, size] = [bounds, extent];
  }
  return best ? [(best[0] + best[2]) / 2, (best[1] + best[3]) / 2] : [0, 0];
}

/** From where to where, as shares of its length, the line between two places is over the ground; null where it is beside it. */
function shareOver([west, south, east, north]: Bounds, [x, y]: readonly number[], [u, v]: readonly number[]): [number, number] | null {
  let [from, to] = [0, 1];
  for (const [at, way, low, high] of [[x, u - x, west, east], [y, v - y, south, north]]) {
    if (way === 0 && (at < low || at > high)) return null;
    if (way === 0) continue;
    const [a, b] = [(low - at) / way, (high - at) / way];
    [from, to] = [Math.max(from, Math.min(a, b)), Math.min(to, Math.max(a, b))];
  }
  return from <= to ? [from, to] : null;
}

/** The line `above_m` over the ground, with corners at most a cell apart where there is ground; a flat line cuts
 * through hills. A control zone of 50 km around a small map has no 200 000 corners for that. */
export function draped(line: readonly (readonly number[])[], heights: Heights, above_m: number): Place[] {
  const spacing_m = heights.frame.cell_size_m;
  const places: Place[] = [];
  let last = 0;
  const put = (east: number, north: number, otherwise: number) => {
    const up = heights.at(east, north);
    last = up === up ? up : otherwise;
    places.push([east, north, last + above_m]);
  };
  line.forEach((corner, k) => {
    if (k > 0) {
      const [x, y] = line[k - 1];
      const pieces = Math.ceil(Math.hypot(corner[0] - x, corner[1] - y) / spacing_m);
      const [from, to] = shareOver(heights.bounds, line[k - 1], corner) ?? [1, 0];
      const end = Math.min(Math.ceil(to * pieces), pieces - 1);
      for (let i = Math.max(Math.floor(from * pieces), 1); i <= end; i++) {
        put(x + ((corner[0] - x) * i) / pieces, y + ((corner[1] - y) * i) / pieces, last);
      }
    }
    put(corner[0], corner[1], corner[2] ?? last);
  });
  return places;
}

export function lineLength(line: readonly (readonly number[])[]): number {
  return line.reduce((sum, [x, y], k) => (k ? sum + Math.hypot(x - line[k - 1][0], y - line[k - 1][1]) : 0), 0);
}

/** Of a simple ring, without sign. */
export function ringArea(ring: readonly (readonly number[])[]): number {
  let twice = 0;
  for (let i = 0, j = ring.length - 1; i < ring.length; j = i++) {
    twice += ring[j][0] * ring[i][1] - ring[i][0] * ring[j][1];
  }
  return Math.abs(twice) / 2;
}

/** Whether two of its sides cross: such a ring says not what is inside. */
export function crossesItself(ring: readonly Corner[]): boolean {
  const side = (a: Corner, b: Corner, c: Corner) =>
    Math.sign((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]));
  const count = ring.length;
  for (let i = 0; i < count; i++) {
    for (let j = i + 1; j < count; j++) {
      if (j === i + 1 || (i === 0 && j === count - 1)) continue;
      const [a, b, c, d] = [ring[i], ring[(i + 1) % count], ring[j], ring[(j + 1) % count]];
      if (side(a, b, c) * side(a, b, d) < 0 && side(c, d, a) * side(c, d, b) < 0) return true;
    }
  }
  return false;
}
