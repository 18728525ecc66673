// Where the viewer stands: an orbit around a place on the ground.

import { OrbitView } from "@deck.gl/core";
import type { Bounds } from "./geometry";
import type { Heights } from "./heights";

export interface Camera {
  target: [east: number, north: number, up: number];
  /** Pixels per metre at the target, as a power of two. */
  zoom: number;
  /** Degrees above the horizon: 90 looks straight down. */
  rotationX: number;
  /** Degrees; 0 looks north. */
  rotationOrbit: number;
}

export const LOWEST_TILT = 8;
const ZOOMS = [-4, 5.5] as const;
const CLOSEST_OVERVIEW = 4;
const FIELD_OF_VIEW = 40;

export const VIEW = new OrbitView({ id: "map", orbitAxis: "Z", fovy: FIELD_OF_VIEW, near: 0.05, far: 100 });

export interface Size {
  width: number;
  height: number;
}

export type Viewport = NonNullable<ReturnType<typeof VIEW.makeViewport>>;

export function viewportOf(camera: Camera, size: Size): Viewport {
  return VIEW.makeViewport({ width: Math.max(size.width, 1), height: Math.max(size.height, 1), viewState: camera })!;
}

/** From and to of the ray through a pixel. */
export function rayThrough(viewport: Viewport, x: number, y: number): [number[], number[]] {
  return [viewport.unproject([x, y, 0.001]), viewport.unproject([x, y, 0.999])];
}

function onPlane(viewport: Viewport, x: number, y: number, up: number): [number, number] | null {
  const [from, to] = rayThrough(viewport, x, y);
  const share = (up - from[2]) / (to[2] - from[2]);
  if (!(share > 0) || !Number.isFinite(share)) return null; // at or above the horizon
  return [from[0] + (to[0] - from[0]) * share, from[1] + (to[1] - from[1]) * share];
}

/** The ground under a pixel, at the height of the target where the map ends. */
export function groundUnder(viewport: Viewport, x: number, y: number, heights: Heights, up: number): [number, number, number] | null {
  const [from, to] = rayThrough(viewport, x, y);
  const met = heights.meets(from, to);
  if (met) return met;
  const plane = onPlane(viewport, x, y, up);
  return plane && [...plane, up];
}

/** The same view moved so that `place` lies under the pixel. */
export function carried(camera: Camera, size: Size, place: readonly number[], x: number, y: number): Camera {
  const now = onPlane(viewportOf(camera, size), x, y, place[2]);
  if (!now) return camera;
  const [east, north, up] = camera.target;
  return { ...camera, target: [east + place[0] - now[0], north + place[1] - now[1], up] };
}

export function bounded(camera: Camera): Camera {
  return {
    ...camera,
    zoom: Math.min(Math.max(camera.zoom, ZOOMS[0]), ZOOMS[1]),
    rotationX: Math.min(Math.max(camera.rotationX, LOWEST_TILT), 90),
    rotationOrbit: ((camera.rotationOrbit + 540) % 360) - 180,
  };
}

/** The same picture, with the target on the ground in its middle, so that turning turns about what is looked at. */
export function settled(camera: Camera, size: Size, heights: Heights): Camera {
  const viewport = viewportOf(camera, size);
  const [from, to] = rayThrough(viewport, size.width / 2, size.height / 2);
  const met = heights.meets(from, to);
  if (!met) return camera;
  const distance = cameraDistance(camera, size);
  const along = (met[0] - camera.target[0]) * (to[0] - from[0]) + (met[1] - camera.target[1]) * (to[1] - from[1]) + (met[2] - camera.target[2]) * (to[2] - from[2]);
  const further = along / Math.hypot(to[0] - from[0], to[1] - from[1], to[2] - from[2]);
  if (distance + further <= 1) return camera;
  return { ...camera, target: met, zoom: camera.zoom + Math.log2(distance / (distance + further)) };
}

function cameraDistance(camera: Camera, size: Size): number {
  return size.height / 2 / Math.tan(((FIELD_OF_VIEW / 2) * Math.PI) / 180) / 2 ** camera.zoom;
}

/** Shows `bounds` as a whole from the south-west. */
export function overview(bounds: Bounds, size: Size, heights: Heights, turn = -28, tilt = 48): Camera {
  const [west, south, east, north] = bounds;
  const middle = [(west + east) / 2, (south + north) / 2] as const;
  const ground = (east: number, north: number) => {
    const up = heights.at(east, north);
    return up === up ? up : 0;
  };
  const target: Camera["target"] = [...middle, ground(...middle)];
  const corners = [[west, south], [east, south], [east, north], [west, north]].map(([x, y]) => [x, y, ground(x, y)]);
  let camera = bounded({ target, zoom: CLOSEST_OVERVIEW, rotationX: tilt, rotationOrbit: turn });
  while (camera.zoom > ZOOMS[0] && !inside(viewportOf(camera, size), corners, size)) {
    camera = { ...camera, zoom: camera.zoom - 0.05 };
  }
  return camera;
}

function inside(viewport: Viewport, places: readonly number[][], { width, height }: Size): boolean {
  return places.every((place) => {
    const [x, y, depth] = viewport.project(place);
    return x > 0.03 * width && x < 0.97 * width && y > 0.05 * height && y < 0.92 * height && depth < 1;
  });
}
