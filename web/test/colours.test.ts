import { describe, expect, it } from "vitest";
import { VoxelState } from "../src/map/belief";
import { CROWD_RAMP, crowdMark, marked, mixed, opacity, PALETTES, type Rgb, type Theme } from "../src/map/colours";

const linear = (byte: number) => (byte / 255 <= 0.04045 ? byte / 255 / 12.92 : ((byte / 255 + 0.055) / 1.055) ** 2.4);

/** CIE L*a*b* (D65) of what eyes without green cones see: Viénot, Brettel and Mollon 1999. */
function seen([r, g, b]: Rgb): number[] {
  const [red, green, blue] = [linear(r), linear(g), linear(b)];
  const yellow = 0.29275 * red + 0.70725 * green;
  const short = -0.02234 * red + 0.02234 * green + blue;
  const xyz = [0.4124 * yellow + 0.3576 * yellow + 0.1805 * short, 0.2126 * yellow + 0.7152 * yellow + 0.0722 * short, 0.0193 * yellow + 0.1192 * yellow + 0.9505 * short];
  const [x, y, z] = xyz.map((value, k) => Math.cbrt(Math.max(value, 1e-6) / [0.9505, 1, 1.089][k]));
  return [116 * y - 16, 500 * (x - y), 200 * (y - z)];
}

const apart = (a: Rgb, b: Rgb) => Math.hypot(...seen(a).map((value, k) => value - seen(b)[k]));

describe("eyes that see no green", () => {
  it.each(["dark", "light"] as Theme[])("tell empty ground from everything else in %s", (theme) => {
    const { states } = PALETTES[theme];
    for (const other of [VoxelState.neverSeen, VoxelState.occluded, VoxelState.stale, VoxelState.notCleared]) {
      expect(apart(states[VoxelState.empty], states[other])).toBeGreaterThan(15); // 2 can be seen side by side
    }
    for (const crowd of CROWD_RAMP) expect(apart(states[VoxelState.empty], crowd)).toBeGreaterThan(15);
  });

  it("also have patterns: only empty ground is plain", () => {
    const patterned = (state: VoxelState) => Array.from({ length: 400 }, (_, k) => marked(state, k % 20, Math.floor(k / 20), 10)).some(Boolean);
    const states = [VoxelState.neverSeen, VoxelState.occluded, VoxelState.empty, VoxelState.stale, VoxelState.crowd, VoxelState.notCleared];
    expect(states.filter((state) => !patterned(state))).toEqual([VoxelState.empty]);
  });
});

describe("a print without colours", () => {
  /** CIE L*, 0 black to 100 white. */
  const lightness = (colour: Rgb) => 116 * Math.cbrt(colour.map(linear).reduce((sum, value, k) => sum + value * [0.2126, 0.7152, 0.0722][k], 0)) - 16;
  const laid = (colour: Rgb, ground: Rgb, alpha: number) => lightness(mixed(ground, colour, alpha));

  it.each(["dark", "light"] as Theme[])("shows the pattern of everything but empty ground, which may be as light, in %s", (theme) => {
    const { shade, states, marks } = PALETTES[theme];
    const pairs = [VoxelState.occluded, VoxelState.stale, VoxelState.notCleared].map((state): [VoxelState, Rgb, Rgb] => [state, states[state], marks[state]]);
    for (const colour of CROWD_RAMP) pairs.push([VoxelState.crowd, colour, crowdMark(colour)]);
    for (const light of [0.5, 0.7, 0.95]) {
      const ground = mixed(shade[0], shade[1], light);
      for (const [state, plain, mark] of pairs) {
        const alpha = opacity(state, 30, 30);
        expect(Math.abs(laid(plain, ground, alpha) - laid(mark, ground, alpha)), `state ${state}`).toBeGreaterThan(7);
      }
    }
  });
});

describe("small print", () => {
  // Colours of style.css: --faint, --soft and --text on --surface, WCAG 2.
  const light = (hex: string) => [1, 3, 5].map((k) => linear(parseInt(hex.slice(k, k + 2), 16))).reduce((sum, value, k) => sum + value * [0.2126, 0.7152, 0.0722][k], 0);
  const contrast = (a: string, b: string) => (Math.max(light(a), light(b)) + 0.05) / (Math.min(light(a), light(b)) + 0.05);
  it("can be read", async () => {
    const { readFileSync } = await import("node:fs");
    const style = readFileSync(new URL("../src/style.css", import.meta.url), "utf8");
    for (const theme of style.split(':root[data-theme="light"]').slice(0, 2)) {
      const colour = (name: string) => new RegExp(`--${name}: (#[0-9a-f]{6})`).exec(theme)![1];
      for (const name of ["faint", "soft", "text", "crowd", "amber", "teal"]) {
        for (const below of ["surface", "raised"]) expect(contrast(colour(name), colour(below))).toBeGreaterThan(4.5);
      }
    }
  });
});
