import { describe, expect, it } from "vitest";
import { ellipsoidalHeight, geodetic, mercator } from "../src/map/earth";

const MILLIMETRE_DEG = 1e-8;

describe("places on Earth", () => {
  // PROJ's topocentric frame: crowdfence.Georeference(46.5, 8.0, 1200.0).geodetic_from_local and one in the south.
  it.each([
    [46.5, 8, 1200, 1000, 1000, 0, 46.508993510455916, 8.013026880113678],
    [46.5, 8, 1200, -768, 396, -250, 46.503561427920985, 7.989995961114272],
    [46.5, 8, 1200, 3000, -2000, 40, 46.48200489654378, 8.039061064279712],
    [-33.9, 151.2, 20, 500, -800, 10, -33.90721221060615, 151.2054062499526],
  ])("are those of PROJ to a millimetre", (latitude_deg, longitude_deg, height_m, east, north, up, latitude, longitude) => {
    const found = geodetic(east, north, up, { latitude_deg, longitude_deg, height_m });
    expect(Math.abs(found[0] - latitude)).toBeLessThan(MILLIMETRE_DEG);
    expect(Math.abs(found[1] - longitude)).toBeLessThan(MILLIMETRE_DEG);
  });

  // PROJ's cart, from the axes by hand: of the anchor's height and `up` alone they were 2 to 8 m too low.
  it.each([
    [46.5, 8, 1200, 0, 0, 30, 1230],
    [46.5, 8, 1200, 3000, 4000, 120, 1321.95995],
    [46.5, 8, 1200, -6000, 8000, 120, 1327.83979],
    [-33, 151, 0, 10_000, 0, 0, 7.83149],
    [88.5, 0, 0, 500, 9000, 50, 56.34805],
  ])("are as high above the ellipsoid as PROJ has it", (latitude_deg, longitude_deg, height_m, east, north, up, wanted_m) => {
    expect(ellipsoidalHeight(east, north, up, { latitude_deg, longitude_deg, height_m })).toBeCloseTo(wanted_m, 3);
  });

  it("lie in the square of web maps", () => {
    expect(mercator(0, 0)).toEqual([0.5, 0.5]);
    expect(mercator(85.0511287798066, -180)[1]).toBeCloseTo(0, 12); // where the square ends
    expect(mercator(0, 90)[0]).toBe(0.75);
  });
});
