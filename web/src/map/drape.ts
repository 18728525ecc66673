// The picture that lies on the terrain: relief, what is known about the ground, zones and footprints.

import type { Outline } from "../api/contract";
import { agedState, lookAge_s, URGENCY, VoxelState, type Belief, type Reading } from "./belief";
import { crowdColour, crowdMark, css, marked, mixed, opacity, type Palette, type Rgb } from "./colours";
import { boundsOf } from "./geometry";
import { Heights } from "./heights";

const MOST_PIXELS = 2048;
const PIXELS_PER_CELL = 4;
const PATTERN_PIXELS = 10;
const CONTOUR_M = 10;
/** The service sends its grid as float32: a millimetre at 10 km. */
const ROUNDING = 0.01;

/** Pixels of the drape and where they lie. */
export interface DrapeFrame {
  west: number;
  north: number;
  pixel_m: number;
  width: number;
  height: number;
}

export function drapeFrame(heights: Heights, most = MOST_PIXELS): DrapeFrame {
  const { west, north, cell_size_m, rows, columns } = heights.frame;
  const pixel_m = Math.max(cell_size_m / PIXELS_PER_CELL, (Math.max(rows, columns) * cell_size_m) / most);
  return {
    west,
    north,
    pixel_m,
    width: Math.max(Math.round((columns * cell_size_m) / pixel_m), 1),
    height: Math.max(Math.round((rows * cell_size_m) / pixel_m), 1),
  };
}

/** In plain memory, where its pixels are made and where they are read from. */
export function drapeCanvas({ width, height }: DrapeFrame): { canvas: OffscreenCanvas; context: OffscreenCanvasRenderingContext2D } {
  const canvas = new OffscreenCanvas(width, height);
  return { canvas, context: canvas.getContext("2d", { willReadFrequently: true })! };
}

/** Light from the north-west, 45 degrees up, as on printed maps; [0, 1] per cell. */
export function hillshade(heights: Heights): Float32Array {
  const { rows, columns, cell_size_m } = heights.frame;
  const shade = new Float32Array(rows * columns);
  const up = (row: number, column: number, otherwise: number) => {
    const value = heights.up_m[Math.min(Math.max(row, 0), rows - 1) * columns + Math.min(Math.max(column, 0), columns - 1)];
    return value === value ? value : otherwise;
  };
  for (let row = 0; row < rows; row++) {
    for (let column = 0; column < columns; column++) {
      const here = up(row, column, 0);
      const eastward = (up(row, column + 1, here) - up(row, column - 1, here)) / (2 * cell_size_m);
      const northward = (up(row - 1, column, here) - up(row + 1, column, here)) / (2 * cell_size_m);
      // Normal (-eastward, -northward, 1) against the light (-1, 1, sqrt 2) / 2.
      const cosine = (eastward - northward + Math.SQRT2) / (2 * Math.hypot(eastward, northward, 1));
      shade[row * columns + column] = Math.min(Math.max(cosine, 0), 1);
    }
  }
  return shade;
}

type Pixels = Uint8ClampedArray<ArrayBuffer>;

/** The ground alone, every pixel of it hatched as never seen. Relief stays visible under everything else. */
export function groundPixels(heights: Heights, frame: DrapeFrame, palette: Palette, colour: Pixels | null): [seen: Pixels, unseen: Pixels] {
  const shade = new Heights(heights.frame, hillshade(heights));
  const seen: Pixels = new Uint8ClampedArray(4 * frame.width * frame.height);
  const unseen: Pixels = new Uint8ClampedArray(seen.length);
  const above = new Int16Array(frame.width).fill(-32_768);
  for (let y = 0; y < frame.height; y++) {
    let left = -32_768;
    for (let x = 0; x < frame.width; x++) {
      const east = frame.west + (x + 0.5) * frame.pixel_m;
      const north = frame.north - (y + 0.5) * frame.pixel_m;
      const [light, up] = [shade.at(east, north), heights.at(east, north)];
      const level = up === up ? Math.floor(up / CONTOUR_M) : -32_768;
      const contour = level !== -32_768 && ((left !== -32_768 && left !== level) || (above[x] !== -32_768 && above[x] !== level));
      left = above[x] = level;
      const k = 4 * (y * frame.width + x);
      let ground = lit(palette, light, colour, k);
      if (contour) ground = mixed(ground, palette.contour, 0.35);
      put(seen, k, ground);
      const hatched = marked(VoxelState.neverSeen, x, y, PATTERN_PIXELS);
      put(unseen, k, mixed(ground, hatched ? palette.hatch : palette.states[VoxelState.neverSeen], hatched ? 0.6 : 0.3));
    }
  }
  return [seen, unseen];
}

function lit(palette: Palette, light: number, colour: Pixels | null, k: number): Rgb {
  if (!colour) return mixed(palette.shade[0], palette.shade[1], light);
  const factor = 0.45 + 0.75 * light;
  return [colour[k] * factor, colour[k + 1] * factor, colour[k + 2] * factor];
}

function put(pixels: Pixels, k: number, [red, green, blue]: Rgb): void {
  pixels[k] = red;
  pixels[k + 1] = green;
  pixels[k + 2] = blue;
  pixels[k + 3] = 255;
}

export interface BeliefStyle extends Reading {
  palette: Palette;
  threshold: number;
  /** 0 to 1: the operator's slider; crowd does not follow it. */
  strength: number;
  /** Colour by age instead of by state. */
  byAge: boolean;
}

/** Lays the belief on the ground: where it says nothing the ground stays hatched. */
export function paintBelief(pixels: Pixels, seen: Pixels, frame: DrapeFrame, belief: Belief, style: BeliefStyle): void {
  const urgency = new Uint8Array(frame.width * frame.height); // of what a pixel shows, 0 = nothing yet
  const crowd = Array.from({ length: 256 }, (_, p) => crowdColour(p / 255, style.threshold));
  const size = belief.cell_size_m / frame.pixel_m;
  const x0 = (belief.west - frame.west) / frame.pixel_m;
  const y0 = (frame.north - belief.south) / frame.pixel_m;
  for (let n = 0; n < belief.count; n++) {
    const age_s = lookAge_s(belief, n, style.older_s);
    const state = agedState(belief.state[n], age_s, style.stale_after_s);
    if (state === VoxelState.neverSeen) continue;
    const rank = URGENCY[state] + 1;
    // Every pixel that it touches: where columns share one, the more urgent has it.
    const left = Math.floor(x0 + belief.columns[n] * size + ROUNDING);
    const right = Math.ceil(x0 + (belief.columns[n] + 1) * size - ROUNDING);
    const bottom = Math.ceil(y0 - belief.rows[n] * size - ROUNDING);
    const top = Math.floor(y0 - (belief.rows[n] + 1) * size + ROUNDING);
    const strength = state === VoxelState.crowd ? 1 : style.strength;
    const alpha = opacity(state, age_s, style.stale_after_s) * strength;
    const plain = style.byAge ? ageColour(state, age_s, style) : state === VoxelState.crowd ? crowd[belief.probability[n]] : style.palette.states[state];
    const mark = state === VoxelState.crowd ? crowdMark(plain) : style.palette.marks[state];
    for (let y = Math.max(top, 0); y < Math.min(bottom, frame.height); y++) {
      for (let x = Math.max(left, 0); x < Math.min(right, frame.width); x++) {
        const at = y * frame.width + x;
        if (urgency[at] >= rank) continue;
        urgency[at] = rank;
        const [red, green, blue] = !style.byAge && marked(state, x, y, PATTERN_PIXELS) ? mark : plain;
        const k = 4 * at;
        // Some of the relief's light goes into the colour, or hills flatten under it.
        const light = style.palette.lift + (0.5 * (seen[k] + seen[k + 1] + seen[k + 2])) / 765;
        pixels[k] = seen[k] * (1 - alpha) + red * light * alpha;
        pixels[k + 1] = seen[k + 1] * (1 - alpha) + green * light * alpha;
        pixels[k + 2] = seen[k + 2] * (1 - alpha) + blue * light * alpha;
        pixels[k + 3] = 255;
      }
    }
  }
}

/** Bright when just seen, dark when stale; crowd keeps its own hue. */
function ageColour(state: VoxelState, age_s: number, style: BeliefStyle): Rgb {
  if (state === VoxelState.occluded) return style.palette.states[state];
  const freshness = Math.exp((-2 * age_s) / style.stale_after_s);
  return freshness > 0.5
    ? mixed([62, 142, 168], [226, 240, 132], 2 * freshness - 1)
    : mixed([44, 38, 92], [62, 142, 168], 2 * freshness);
}

export interface Area {
  outline: Outline;
  fill: Rgb;
  alpha: number;
  hatched: boolean;
}

/** Zones and footprints as areas on the ground. */
export function paintAreas(canvas: OffscreenCanvasRenderingContext2D, frame: DrapeFrame, areas: readonly Area[]): void {
  const x = (east: number) => (east - frame.west) / frame.pixel_m;
  const y = (north: number) => (frame.north - north) / frame.pixel_m;
  for (const { outline, fill, alpha, hatched } of areas) {
    const bounds = boundsOf(outline.flat(2));
    if (!bounds) continue;
    const [west, south, east, north] = bounds;
    const box: Box = { left: Math.max(x(west), 0), right: Math.min(x(east), frame.width), top: Math.max(y(north), 0), bottom: Math.min(y(south), frame.height) };
    if (box.left >= box.right || box.top >= box.bottom) continue; // beside the map
    canvas.beginPath();
    for (const ring of outline.flat()) {
      ring.forEach(([east, north], k) => (k ? canvas.lineTo(x(east), y(north)) : canvas.moveTo(x(east), y(north))));
      canvas.closePath();
    }
    canvas.fillStyle = css(fill, alpha);
    canvas.fill("evenodd");
    if (hatched) hatch(canvas, fill, box);
  }
}

interface Box {
  left: number;
  right: number;
  top: number;
  bottom: number;
}

const HATCH_PIXELS = 12;
const HATCH_WIDTH = 2;

/** Lines that go on from one area to the next, drawn no farther than the area: there may be thousands. */
function hatch(canvas: OffscreenCanvasRenderingContext2D, colour: Rgb, { left, right, top, bottom }: Box): void {
  canvas.save();
  canvas.clip("evenodd");
  canvas.strokeStyle = css(colour, 0.55);
  canvas.lineWidth = HATCH_WIDTH;
  canvas.beginPath();
  const [from, to] = [Math.floor((left + top) / HATCH_PIXELS), Math.ceil((right + bottom) / HATCH_PIXELS)];
  for (let k = from; k <= to; k++) {
    const sum = k * HATCH_PIXELS; // of x and y, all along a line
    canvas.moveTo(sum - bottom - HATCH_WIDTH, bottom + HATCH_WIDTH);
    canvas.lineTo(sum - top + HATCH_WIDTH, top - HATCH_WIDTH);
  }
  canvas.stroke();
  canvas.restore();
}
