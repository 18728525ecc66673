import { describe, expect, it } from "vitest";
import { parseBelief, VoxelState } from "../src/map/belief";
import { CROWD_RAMP, crowdColour, marked, opacity, PALETTES, type Rgb, type Theme } from "../src/map/colours";
import { drapeFrame, groundPixels, hillshade, paintAreas, paintBelief } from "../src/map/drape";
import { Heights } from "../src/map/heights";

const FRAME = { west: 0, north: 20, cell_size_m: 1, rows: 20, columns: 20 };
const PLAIN = new Heights(FRAME, new Float32Array(400));

/** One column of each state along row 10, columns 2, 4, 6, ...; `ages` in tenths of a second. */
function beliefOf(states: VoxelState[], age = 0, probability = 200) {
  const n = states.length;
  const buffer = new ArrayBuffer(24 + 12 * n);
  const view = new DataView(buffer);
  view.setUint32(0, n, true);
  view.setFloat32(12, 1, true);
  states.forEach((state, k) => {
    view.setUint16(24 + 2 * k, 2 + 2 * k, true);
    view.setUint16(24 + 2 * n + 2 * k, 10, true);
    view.setUint8(24 + 8 * n + k, probability);
    view.setUint8(24 + 9 * n + k, state);
    view.setUint16(24 + 10 * n + 2 * k, age, true);
  });
  return parseBelief(buffer);
}

function painted(theme: Theme, states: VoxelState[], age = 0, strength = 1, older_s = 0): { of: (k: number) => Rgb; never: Rgb } {
  const palette = PALETTES[theme];
  const frame = drapeFrame(PLAIN);
  const [seen, unseen] = groundPixels(PLAIN, frame, palette, null);
  const pixels = new Uint8ClampedArray(unseen);
  paintBelief(pixels, seen, frame, beliefOf(states, age), { palette, threshold: 0.07, stale_after_s: 30, older_s, strength, byAge: false });
  const mean = (column: number): Rgb => {
    const sum = [0, 0, 0];
    const side = 1 / frame.pixel_m;
    for (let y = 0; y < side; y++) {
      for (let x = 0; x < side; x++) {
        const k = 4 * ((9 * side + y) * frame.width + column * side + x); // row 10 from the south of 20
        for (let c = 0; c < 3; c++) sum[c] += pixels[k + c] / side ** 2;
      }
    }
    return [sum[0], sum[1], sum[2]];
  };
  return { of: (k) => mean(2 + 2 * k), never: mean(17) };
}

const apart = (a: Rgb, b: Rgb) => Math.hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);

describe.each<Theme>(["dark", "light"])("the drape, %s", (theme) => {
  const states = [VoxelState.empty, VoxelState.notCleared, VoxelState.stale, VoxelState.occluded, VoxelState.crowd];

  it("shows every state in a colour of its own, and none like never seen ground", () => {
    const { of, never } = painted(theme, states);
    const colours = [...states.map((_, k) => of(k)), never];
    colours.forEach((one, k) => colours.slice(k + 1).forEach((other) => expect(apart(one, other)).toBeGreaterThan(18)));
  });

  it("fades ground with the age of its look, but never crowd", () => {
    const [fresh, old] = [painted(theme, states, 0), painted(theme, states, 600)];
    expect(apart(fresh.of(0), old.of(0))).toBeGreaterThan(12);
    expect(old.of(4)).toEqual(fresh.of(4));
  });

  it("shows empty ground as stale once nobody has looked for long, and crowd as crowd", () => {
    const [fresh, later] = [painted(theme, states), painted(theme, states, 0, 1, 31)];
    expect(later.of(0)).toEqual(later.of(2));
    expect(apart(fresh.of(0), later.of(0))).toBeGreaterThan(18);
    expect(later.of(4)).toEqual(fresh.of(4));
  });

  it("leaves crowd as it is when the operator turns colours down", () => {
    const [full, faint] = [painted(theme, states, 0, 1), painted(theme, states, 0, 0.2)];
    expect(faint.of(4)).toEqual(full.of(4));
    expect(apart(faint.of(0), full.of(0))).toBeGreaterThan(12);
  });
});

it("shows the least known of what falls on one pixel, and crowd before all", () => {
  const wide = new Heights({ west: 0, north: 4096, cell_size_m: 4, rows: 1024, columns: 1024 }, new Float32Array(1024 ** 2));
  const frame = drapeFrame(wide, 512); // 8 m a pixel, so that columns of 1 m share one
  const pixels = new Uint8ClampedArray(4 * frame.width * frame.height);
  const seen = new Uint8ClampedArray(pixels.length).fill(100);
  const style = { palette: PALETTES.dark, threshold: 0.07, stale_after_s: 30, older_s: 0, strength: 1, byAge: false };
  const shown = (states: VoxelState[]) => {
    pixels.fill(0);
    paintBelief(pixels, seen, frame, beliefOf(states), style);
    const k = 4 * ((frame.height - 1 - Math.floor(10 / frame.pixel_m)) * frame.width);
    return [...pixels.slice(k, k + 3)];
  };
  expect(frame.pixel_m).toBe(8);
  const only = (state: VoxelState) => shown([state]);
  expect(shown([VoxelState.crowd, VoxelState.empty])).toEqual(only(VoxelState.crowd));
  expect(shown([VoxelState.empty, VoxelState.crowd])).toEqual(only(VoxelState.crowd));
  expect(shown([VoxelState.empty, VoxelState.notCleared])).toEqual(only(VoxelState.notCleared));
  expect(shown([VoxelState.occluded, VoxelState.notCleared])).toEqual(only(VoxelState.occluded));
});

describe("colours", () => {
  it("get darker as crowd gets surer, so that the order needs no hue", () => {
    const lightness = (p: number) => {
      const [red, green, blue] = crowdColour(p, 0.1);
      return 0.2126 * red + 0.7152 * green + 0.0722 * blue;
    };
    for (let p = 0.1; p < 0.99; p += 0.05) expect(lightness(p + 0.05)).toBeLessThan(lightness(p));
    expect(crowdColour(0.1, 0.1)).toEqual(CROWD_RAMP[0]);
    expect(crowdColour(1, 0.1)).toEqual(CROWD_RAMP.at(-1));
  });

  it("give every state but what was seen empty a pattern", () => {
    const has = (state: VoxelState) => [...Array(400).keys()].some((k) => marked(state, k % 20, Math.floor(k / 20), 10));
    const patterned = [VoxelState.neverSeen, VoxelState.occluded, VoxelState.notCleared, VoxelState.stale, VoxelState.crowd];
    expect(patterned.every(has)).toBe(true);
    expect(has(VoxelState.empty)).toBe(false);
  });

  it("stay visible however old the look is", () => {
    for (let state = 0; state < 6; state++) expect(opacity(state, Infinity, 30)).toBeGreaterThan(0.25);
  });
});

describe("relief", () => {
  it("is lit from the north-west", () => {
    const slope = (towards: (column: number, row: number) => number) =>
      hillshade(new Heights(FRAME, Float32Array.from({ length: 400 }, (_, k) => towards(k % 20, Math.floor(k / 20)))))[210];
    const flat = slope(() => 5);
    expect(flat).toBeCloseTo(Math.SQRT1_2, 6);
    expect(slope((column) => column)).toBeGreaterThan(flat); // rises to the east: faces west
    expect(slope((column) => -column)).toBeLessThan(flat);
    expect(slope((_, row) => row)).toBeGreaterThan(flat); // rises to the south: faces north
  });
});

describe("areas", () => {
  /** Of a canvas that only listens: what was stroked, from and to, and how often something was filled. */
  function drawn(...corners: [number, number][][]) {
    const lines: [number, number, number, number][] = [];
    let path: [number, number][] = [];
    let fills = 0;
    const canvas = {
      beginPath: () => (path = []),
      moveTo: (x: number, y: number) => path.push([x, y]),
      lineTo: (x: number, y: number) => path.push([x, y]),
      closePath: () => {},
      save: () => {},
      restore: () => {},
      clip: () => {},
      fill: () => fills++,
      stroke: () => {
        for (let k = 0; k < path.length; k += 2) lines.push([...path[k], ...path[k + 1]]);
      },
    };
    const frame = { west: 0, north: 1000, pixel_m: 1, width: 1000, height: 1000 };
    const areas = corners.map((ring) => ({ outline: [[ring]], fill: [1, 2, 3] as Rgb, alpha: 0.2, hatched: true }));
    paintAreas(canvas as unknown as OffscreenCanvasRenderingContext2D, frame, areas);
    return { lines, fills };
  }
  const square = (west: number, south: number, side: number): [number, number][] => [[west, south], [west + side, south], [west + side, south + side], [west, south + side]];

  it("are hatched no farther than they reach: a thousand of them cost no more than one as large", () => {
    const { lines } = drawn(square(100, 880, 24)); // x from 100 to 124, y from 96 to 120
    const sums = lines.map(([x, y]) => x + y);
    expect(lines.every(([x0, y0, x1, y1]) => x0 + y0 === x1 + y1)).toBe(true);
    expect(sums.every((sum) => sum % 12 === 0)).toBe(true); // so that lines go on in the next area
    for (const sum of [204, 216, 228, 240]) expect(sums).toContain(sum); // all that cross it, from 196 to 244
    const length = (some: typeof lines) => some.reduce((all, [x0, y0, x1, y1]) => all + Math.hypot(x1 - x0, y1 - y0), 0);
    expect(length(lines)).toBeLessThan(6 * 28 * Math.SQRT2 + 1e-9);
    for (const [x0, y0, x1, y1] of lines) {
      expect([Math.max(y0, y1), Math.min(y0, y1)]).toEqual([122, 94]);
      expect(Math.abs(x0 - x1)).toBe(28);
    }
  });

  it("beside the map are not drawn, however large", () => {
    expect(drawn(square(-5000, 0, 4000), square(1000, 0, 9)).fills).toBe(0);
    const { lines, fills } = drawn(square(-50_000, -50_000, 200_000));
    expect(fills).toBe(1);
    expect(lines.length).toBeLessThan(170); // 2000 / 12
  });
});
