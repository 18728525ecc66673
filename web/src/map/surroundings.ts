// The base map: a sheet below the block of ground, and the same picture laid on the ground itself.

import type { Anchor } from "../api/contract";
import { geodetic, mercator } from "./earth";
import type { Bounds } from "./geometry";
import { mesh, type Mesh } from "./terrain_mesh";

/** A rectangle of the square of web maps; y runs southward. */
export interface Extent {
  west: number;
  north: number;
  east: number;
  south: number;
}

/** How far the sheet reaches beyond the ground, of its longer side. */
const MARGIN = 0.9;
const KNOTS = 17;

/** Ground and margin, in local metres. */
export function sheetBounds([west, south, east, north]: Bounds): Bounds {
  const margin = MARGIN * Math.max(east - west, north - south);
  return [west - margin, south - margin, east + margin, north + margin];
}

/** The extent that covers bounds; north is not quite up in a local frame, so it is a little larger. */
export function extentOf(bounds: Bounds, anchor: Anchor): Extent {
  const corners = places(bounds).map(([east, north]) => mercator(...geodetic(east, north, 0, anchor)));
  const [x, y] = [corners.map((corner) => corner[0]), corners.map((corner) => corner[1])];
  return { west: Math.min(...x), east: Math.max(...x), north: Math.min(...y), south: Math.max(...y) };
}

function places([west, south, east, north]: Bounds): [east: number, north: number][] {
  const at = (from: number, to: number, k: number) => from + ((to - from) * k) / (KNOTS - 1);
  return Array.from({ length: KNOTS * KNOTS }, (_, k) => [at(west, east, k % KNOTS), at(north, south, Math.floor(k / KNOTS))]);
}

/** Share of a picture of `extent` at which a place lies: from its left, from its top. */
export function shareAt(east: number, north: number, extent: Extent, anchor: Anchor): [number, number] {
  const [x, y] = mercator(...geodetic(east, north, 0, anchor));
  return [(x - extent.west) / (extent.east - extent.west), (y - extent.north) / (extent.south - extent.north)];
}

/** A flat grid at a height whose texture is a picture; `share` says where in it each place lies. */
export function sheetMesh(bounds: Bounds, up_m: number, share: (east: number, north: number) => [number, number]): Mesh {
  const positions: number[] = [];
  const texCoords: number[] = [];
  const indices: number[] = [];
  places(bounds).forEach(([east, north], k) => {
    positions.push(east, north, up_m);
    texCoords.push(...share(east, north));
    const [row, column] = [Math.floor(k / KNOTS), k % KNOTS];
    if (row + 1 < KNOTS && column + 1 < KNOTS) indices.push(k, k + KNOTS, k + 1, k + 1, k + KNOTS, k + KNOTS + 1);
  });
  return mesh(positions, texCoords, indices);
}

/** Where a picture of `extent` has the rectangle `bounds`: left, top, width, height in its pixels. */
export function cutOut(bounds: Bounds, extent: Extent, anchor: Anchor, width: number, height: number): [number, number, number, number] {
  const [west, south, east, north] = bounds;
  const middle: [number, number] = [(west + east) / 2, (south + north) / 2];
  const left = shareAt(west, middle[1], extent, anchor)[0] * width;
  const right = shareAt(east, middle[1], extent, anchor)[0] * width;
  const top = shareAt(middle[0], north, extent, anchor)[1] * height;
  const bottom = shareAt(middle[0], south, extent, anchor)[1] * height;
  return [left, top, right - left, bottom - top];
}
