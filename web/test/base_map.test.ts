import { describe, expect, it } from "vitest";
import { rasterStyle, vectorStyle } from "../src/map/base_style";
import { geodetic, mercator } from "../src/map/earth";
import { cutOut, extentOf, shareAt, sheetBounds, sheetMesh } from "../src/map/surroundings";

const ANCHOR = { latitude_deg: 46.5, longitude_deg: 8, height_m: 1200 };

describe("the picture of the surroundings", () => {
  it("covers every place of the bounds", () => {
    const bounds: [number, number, number, number] = [-700, -400, 900, 1200];
    const extent = extentOf(bounds, ANCHOR);
    for (const [east, north] of [[-700, -400], [900, -400], [900, 1200], [-700, 1200], [100, 1200], [900, 0]]) {
      const [x, y] = shareAt(east, north, extent, ANCHOR);
      expect(Math.min(x, y)).toBeGreaterThan(-1e-9);
      expect(Math.max(x, y)).toBeLessThan(1 + 1e-9);
    }
  });

  it("has a place where a web map has it", () => {
    // PROJ's EPSG:3857 of 46.5 N 8.0 E, in tiles of zoom 17; for x by hand: (8 + 180) / 360 * 2^17.
    const [x, y] = mercator(...geodetic(0, 0, 0, ANCHOR)).map((share) => share * 2 ** 17);
    expect(x).toBeCloseTo(68448.7111, 3);
    expect(y).toBeCloseTo(46367.1496, 3);
  });

  it("is laid on the ground within half a metre, although north is not quite up in it", () => {
    const bounds: [number, number, number, number] = [-700, -400, 900, 1200];
    const wide = extentOf(sheetBounds(bounds), ANCHOR);
    const [left, top, width, height] = cutOut(bounds, wide, ANCHOR, 4096, 4096);
    const pixel_m = 1600 / width;
    for (const [east, north] of [[-700, 1200], [900, -400], [100, 400], [500, 900]]) {
      const [x, y] = shareAt(east, north, wide, ANCHOR).map((share) => share * 4096);
      expect(Math.abs(left + ((east + 700) / 1600) * width - x) * pixel_m).toBeLessThan(0.5);
      expect(Math.abs(top + ((1200 - north) / 1600) * height - y) * pixel_m).toBeLessThan(0.5);
    }
  });

  it("lies flat at the foot of the ground", () => {
    const { attributes, indices } = sheetMesh([0, 0, 16, 16], -5, (east, north) => [east / 16, 1 - north / 16]);
    const places = attributes.positions.value;
    expect(new Set(places.filter((_, k) => k % 3 === 2))).toEqual(new Set([-5]));
    expect(indices.value.length).toBe(2 * 3 * 16 * 16);
    // Every triangle is seen from above: counter-clockwise.
    for (let k = 0; k < indices.value.length; k += 3) {
      const [a, b, c] = [0, 1, 2].map((n) => places.slice(3 * indices.value[k + n], 3 * indices.value[k + n] + 2));
      expect((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])).toBeGreaterThan(0);
    }
  });
});

describe("the style of a base map", () => {
  const layers = (names: string[]) => vectorStyle("http://here/base", names, "dark").layers.map(({ id }) => id);

  it("knows the layers of the usual schemas", () => {
    // Protomaps, OpenMapTiles and Shortbread name them so.
    expect(layers(["boundaries", "buildings", "earth", "landcover", "landuse", "places", "pois", "roads", "water"])).toEqual(["land", "landcover-areas", "landuse-areas", "water-areas", "water-lines", "roads-lines", "buildings-areas"]);
    expect(layers(["transportation", "transportation_name", "building", "waterway", "poi"])).toEqual(["land", "waterway-areas", "waterway-lines", "transportation-lines", "building-areas"]);
    expect(layers(["ocean", "water_polygons", "water_lines_labels", "streets", "street_labels", "street_polygons"])).toContain("streets-lines");
  });

  it("has no letters, which would have to come from somewhere", () => {
    const style = vectorStyle("http://here/base", ["roads", "street_labels", "places"], "light");
    expect(style.layers.some(({ type }) => type === "symbol")).toBe(false);
    expect(style.glyphs ?? style.sprite).toBeUndefined();
  });

  it("asks the service alone", () => {
    for (const style of [rasterStyle("http://here/base", "light"), vectorStyle("http://here/base", ["roads"], "dark")]) {
      expect(JSON.stringify(style).match(/[a-z]+:\/\/[^"]*/g)).toEqual(["pmtiles://http://here/base"]);
    }
  });
});
