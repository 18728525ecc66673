// Colours and patterns of the map. A state has a hue and a pattern, so that it is told from the others by eyes
// that see no red and green and on a print without colours. Crowd gets darker as it gets surer, as in the exports,
// and is once as light as empty ground, which alone is plain.

import { VoxelState } from "./belief";

export type Rgb = readonly [red: number, green: number, blue: number];
export type Theme = "dark" | "light";

export interface Palette {
  /** Ground in full shade and in full light, before anything lies on it. */
  shade: readonly [Rgb, Rgb];
  /** Lines of the hatching of never seen ground. */
  hatch: Rgb;
  contour: Rgb;
  /** How bright a colour is on ground in full shade. */
  lift: number;
  skirt: Rgb;
  states: Record<VoxelState, Rgb>;
  /** Second colour of a pattern. */
  marks: Record<VoxelState, Rgb>;
  zone: Rgb;
  buffer: Rgb;
  operator: Rgb;
  selected: Rgb;
  background: Rgb;
  /** Of the drones, in their order; Okabe and Ito. */
  drones: readonly Rgb[];
}

export const CROWD_RAMP: readonly Rgb[] = [
  [255, 221, 87],
  [255, 160, 48],
  [229, 72, 38],
  [160, 10, 52],
];

export const PALETTES: Record<Theme, Palette> = {
  dark: {
    shade: [[22, 26, 32], [104, 112, 122]],
    hatch: [16, 19, 24],
    contour: [138, 150, 162],
    lift: 0.9,
    skirt: [24, 29, 36],
    states: {
      [VoxelState.neverSeen]: [62, 68, 76],
      [VoxelState.occluded]: [44, 38, 36],
      [VoxelState.empty]: [104, 222, 206],
      [VoxelState.stale]: [92, 112, 128],
      [VoxelState.crowd]: [229, 72, 38],
      [VoxelState.notCleared]: [152, 128, 196],
    },
    marks: {
      [VoxelState.neverSeen]: [34, 38, 45],
      [VoxelState.occluded]: [164, 154, 146],
      [VoxelState.empty]: [104, 222, 206],
      [VoxelState.stale]: [52, 168, 158],
      [VoxelState.crowd]: [137, 43, 23],
      [VoxelState.notCleared]: [92, 70, 140],
    },
    zone: [255, 96, 92],
    buffer: [255, 178, 36],
    operator: [255, 255, 255],
    selected: [255, 255, 255],
    background: [11, 15, 20],
    drones: [[86, 180, 233], [240, 228, 66], [230, 130, 190], [0, 190, 140], [255, 170, 60], [170, 170, 255]],
  },
  light: {
    shade: [[128, 132, 134], [236, 238, 236]],
    hatch: [112, 118, 124],
    contour: [112, 118, 122],
    lift: 0.74,
    skirt: [156, 162, 166],
    states: {
      [VoxelState.neverSeen]: [178, 182, 186],
      [VoxelState.occluded]: [70, 72, 80],
      [VoxelState.empty]: [30, 150, 138],
      [VoxelState.stale]: [132, 162, 190],
      [VoxelState.crowd]: [229, 72, 38],
      [VoxelState.notCleared]: [198, 176, 232],
    },
    marks: {
      [VoxelState.neverSeen]: [130, 136, 142],
      [VoxelState.occluded]: [190, 192, 196],
      [VoxelState.empty]: [30, 150, 138],
      [VoxelState.stale]: [46, 116, 122],
      [VoxelState.crowd]: [137, 43, 23],
      [VoxelState.notCleared]: [136, 104, 190],
    },
    zone: [196, 16, 40],
    buffer: [206, 108, 0],
    operator: [20, 24, 30],
    selected: [10, 14, 20],
    background: [226, 231, 235],
    drones: [[0, 92, 190], [150, 90, 0], [170, 40, 120], [0, 120, 86], [190, 70, 0], [84, 64, 190]],
  },
};

export function droneColour(palette: Palette, names: readonly string[], drone: string): Rgb {
  return palette.drones[Math.max(names.indexOf(drone), 0) % palette.drones.length];
}

export function css([red, green, blue]: Rgb, alpha = 1): string {
  return `rgb(${red} ${green} ${blue} / ${alpha})`;
}

/** Colour of crowd: yellow at the threshold, dark red at one. */
export function crowdColour(probability: number, threshold: number): Rgb {
  const share = Math.min(Math.max((probability - threshold) / Math.max(1 - threshold, 1e-9), 0), 1);
  const at = share * (CROWD_RAMP.length - 1);
  const k = Math.min(Math.floor(at), CROWD_RAMP.length - 2);
  return mixed(CROWD_RAMP[k], CROWD_RAMP[k + 1], at - k);
}

/** Of the pattern on a colour of crowd. */
export const crowdMark = (colour: Rgb): Rgb => mixed(colour, [0, 0, 0], 0.4);

export function mixed(a: Rgb, b: Rgb, share: number): Rgb {
  const of = (k: number) => Math.round(a[k] + (b[k] - a[k]) * share);
  return [of(0), of(1), of(2)];
}

/** How much of a state covers the ground under it: less the older the look, but crowd never fades. */
export function opacity(state: VoxelState, age_s: number, stale_after_s: number): number {
  const freshness = Math.exp(-age_s / stale_after_s);
  switch (state) {
    case VoxelState.crowd:
      return 0.9;
    case VoxelState.empty:
      return 0.3 + 0.42 * freshness;
    case VoxelState.notCleared:
      return 0.38 + 0.24 * freshness;
    case VoxelState.stale:
      return 0.55;
    default:
      return 0.8;
  }
}

/** Whether a pixel of the drape belongs to the pattern of its state; `pitch` pixels apart. */
export function marked(state: VoxelState, x: number, y: number, pitch: number): boolean {
  const thick = Math.max(1, Math.round(pitch / 5));
  switch (state) {
    case VoxelState.neverSeen:
      return (x + y) % pitch < thick;
    case VoxelState.occluded:
      return (x + y) % pitch < thick || (x - y + 65_536 * pitch) % pitch < thick;
    case VoxelState.notCleared:
      return x % pitch < thick + 1 && (y + (Math.floor(x / pitch) % 2) * (pitch >> 1)) % pitch < thick + 1;
    case VoxelState.stale:
      return y % pitch < thick;
    case VoxelState.crowd:
      return (Math.floor((2 * x) / pitch) + Math.floor((2 * y) / pitch)) % 2 === 0;
    default:
      return false;
  }
}
