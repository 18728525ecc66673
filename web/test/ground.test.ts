import { describe, expect, it } from "vitest";
import { bounded, carried, groundUnder, overview, settled, viewportOf, type Camera } from "../src/map/camera";
import { boundsOf, contains, crossesItself, draped, groundOf, lineLength, middleOf, onMap, ringArea } from "../src/map/geometry";
import { turned } from "../src/map/gestures";
import { Heights } from "../src/map/heights";
import { skirtMesh, terrainMesh } from "../src/map/terrain_mesh";
import type { Corner, Outline } from "../src/api/contract";

const FRAME = { west: -50, north: 50, cell_size_m: 1, rows: 100, columns: 100 };
const middles = (of: (east: number, north: number) => number) =>
  new Heights(FRAME, Float32Array.from({ length: 10_000 }, (_, k) => of(-49.5 + (k % 100), 49.5 - Math.floor(k / 100))));
const SLOPE = middles((east, north) => 0.3 * east + 0.1 * north + 20);
const SIZE = { width: 800, height: 600 };
const CAMERA: Camera = { target: [0, 0, 20], zoom: 2.5, rotationX: 45, rotationOrbit: 30 };

describe("the ground that is worth showing", () => {
  const map: [number, number, number, number] = [-690, 20, -520, 160];

  it("is that of zones and drones, with an eighth of it around", () => {
    expect(groundOf([[-650, 40], [-550, 90]], map)).toEqual([-662, 28, -538, 102]);
    expect(groundOf([[-600, 40]], map)).toEqual([-607.2, 32.8, -592.8, 47.2]); // 12 % of 60 m
    expect(groundOf([[-600, 40], [0, 40]], map)).toEqual([-672, -32, 72, 112]); // one of them beside it
  });

  it("is the map where nothing is on it, or all beside it", () => {
    expect(groundOf([], map)).toEqual(map);
    for (const place of [[30, 30], [-900, 90], [-600, 200], [-600, -40]]) expect(groundOf([place], map)).toEqual(map);
  });

  it("is of a zone far larger than the map the part on it", () => {
    expect(onMap([-30_000, -30_000, 30_000, 30_000], map)).toEqual(map);
    expect(onMap([-700, 40, -600, 900], map)).toEqual([-690, 40, -600, 160]);
    for (const beside of [[-519, 40, 0, 90], [-650, 161, -600, 190]]) expect(onMap(beside as [number, number, number, number], map)).toBeNull();
  });
});

describe("heights", () => {
  it("are exact on a plane between the middles of cells", () => {
    expect(SLOPE.at(-12.3, 7.9)).toBeCloseTo(0.3 * -12.3 + 0.1 * 7.9 + 20, 4);
    expect(SLOPE.at(-50.1, 0)).toBeNaN();
    expect(SLOPE.at(0, 50.1)).toBeNaN();
  });

  it("stay where they are when thinned", () => {
    const thin = SLOPE.thinned(5);
    expect([thin.frame.rows, thin.frame.columns, thin.frame.cell_size_m]).toEqual([20, 20, 5]);
    expect(thin.at(3.7, -8.1)).toBeCloseTo(0.3 * 3.7 - 0.81 + 20, 3);
  });

  it("are drawn to the edge of the map, whatever the thinning leaves over", () => {
    const frame = { west: 7, north: -3, cell_size_m: 0.5, rows: 103, columns: 67 }; // 51.5 x 33.5 m
    const ground = new Heights(frame, Float32Array.from({ length: 103 * 67 }, (_, k) => Math.sin(k % 67) + Math.floor(k / 67)));
    for (const step of [1, 2, 4, 7, 8, 9, 40, 200]) {
      const thin = ground.thinned(step);
      const [rows, columns] = [Math.max(Math.round(103 / step), 1), Math.max(Math.round(67 / step), 1)];
      expect([thin.frame.rows, thin.frame.columns], `${step}`).toEqual([rows, columns]);
      expect(thin.up_m.every((up) => up === up)).toBe(true);
      for (const drawn of [terrainMesh(thin), skirtMesh(thin, -9)]) {
        const [eastings, northings] = [0, 1].map((axis) => drawn.attributes.positions.value.filter((_, k) => k % 3 === axis));
        expect([Math.min(...eastings), Math.max(...eastings)]).toEqual([7, 40.5]);
        expect([Math.min(...northings), Math.max(...northings)]).toEqual([-54.5, -3]);
      }
      const { positions, texCoords } = terrainMesh(thin).attributes;
      for (let k = 0; k < positions.value.length / 3; k++) {
        const [east, north, up] = positions.value.slice(3 * k, 3 * k + 3);
        expect(Math.abs(thin.at(east, north) - up)).toBeLessThan(1e-3); // lines on the ground are neither below it nor above
        expect(texCoords.value[2 * k]).toBeCloseTo((east - 7) / 33.5, 5);
        expect(texCoords.value[2 * k + 1]).toBeCloseTo((-3 - north) / 51.5, 5);
      }
    }
    expect(ground.thinned(8).at(40.49, -54.49)).not.toBeNaN();
    expect(ground.thinned(8).at(40.51, -54.49)).toBeNaN();
  });

  it("have holes where the map has", () => {
    const holed = middles((east, north) => (Math.hypot(east, north) < 5 ? NaN : 3));
    expect(holed.at(0, 0)).toBeNaN();
    expect(holed.range_m).toEqual([3, 3]);
    const vertices = terrainMesh(holed).indices.value.length;
    expect(vertices).toBeLessThan(101 * 101 * 6); // between 100 middles and two edges
    expect(vertices).toBeGreaterThan(101 * 101 * 6 - 6 * 12 * 12);
  });

  it("refuse terrain of another size than was announced", () => {
    expect(() => new Heights(FRAME, new Float32Array(9999))).toThrow(/9999/);
  });

  it("stop a ray where it meets the ground", () => {
    const met = SLOPE.meets([0, 0, 70], [10, 0, -30])!;
    expect(met[2]).toBeCloseTo(0.3 * met[0] + 20, 2);
    expect(SLOPE.meets([0, 0, 70], [0, 0, 120])).toBeNull();
  });

  it("become a skirt around four sides", () => {
    const skirt = skirtMesh(SLOPE, -10);
    expect(skirt.indices.value.length).toBe(4 * 101 * 6);
    expect(Math.min(...skirt.attributes.positions.value.filter((_, k) => k % 3 === 2))).toBe(-10);
  });
});

describe("the camera", () => {
  it("looks at its target in the middle", () => {
    const [x, y] = viewportOf(CAMERA, SIZE).project(CAMERA.target);
    expect([x, y]).toEqual([expect.closeTo(400, 3), expect.closeTo(300, 3)]);
  });

  it("finds the ground that a pixel shows", () => {
    const viewport = viewportOf(CAMERA, SIZE);
    for (const [east, north] of [[0, 0], [-20, 11], [14, -9]]) {
      const up = SLOPE.at(east, north);
      const [x, y] = viewport.project([east, north, up]);
      const [u, v] = groundUnder(viewport, x, y, SLOPE, 20)!;
      expect(Math.hypot(u - east, v - north)).toBeLessThan(0.2);
    }
  });

  it("carries the ground with the pointer", () => {
    const held = [6, -4, 21];
    const moved = carried(CAMERA, SIZE, held, 610, 190);
    const [x, y] = viewportOf(moved, SIZE).project(held);
    expect([x, y]).toEqual([expect.closeTo(610, 2), expect.closeTo(190, 2)]);
    expect(moved.target[2]).toBe(CAMERA.target[2]);
  });

  it("comes to rest on the ground without a change of the picture", () => {
    const floating: Camera = { ...CAMERA, target: [0, 0, 45] };
    const rested = settled(floating, SIZE, SLOPE);
    expect(rested.target[2]).toBeCloseTo(SLOPE.at(rested.target[0], rested.target[1]), 1);
    const [before, after] = [viewportOf(floating, SIZE), viewportOf(rested, SIZE)];
    for (const place of [[5, 5, 22], [-12, 8, 16], [0, -20, 18]]) {
      const [a, b] = [before.project(place), after.project(place)];
      expect(Math.hypot(a[0] - b[0], a[1] - b[1])).toBeLessThan(0.5);
    }
  });

  it("keeps above the horizon and counts turns within one", () => {
    expect(turned(CAMERA, 0, -1000).rotationX).toBe(8);
    expect(turned(CAMERA, 0, 1000).rotationX).toBe(90);
    expect(bounded({ ...CAMERA, rotationOrbit: 725 }).rotationOrbit).toBeCloseTo(5);
    expect(bounded({ ...CAMERA, zoom: 99 }).zoom).toBeLessThan(10);
  });

  it("shows all of what it is asked to show", () => {
    const viewport = viewportOf(overview([-40, -30, 40, 30], SIZE, SLOPE), SIZE);
    for (const [east, north] of [[-40, -30], [40, -30], [40, 30], [-40, 30]]) {
      const [x, y] = viewport.project([east, north, SLOPE.at(east, north)]);
      expect(x > 0 && x < SIZE.width && y > 0 && y < SIZE.height).toBe(true);
    }
  });
});

describe("outlines", () => {
  const SQUARE: Corner[] = [[0, 0], [10, 0], [10, 10], [0, 10], [0, 0]];
  const HOLE: Corner[] = [[4, 4], [6, 4], [6, 6], [4, 6], [4, 4]];
  const FAR: Corner[] = [[30, 0], [32, 0], [32, 2], [30, 0]];
  const ZONE: Outline = [[SQUARE, HOLE], [FAR]];

  it("contain their parts without their holes", () => {
    expect(contains(ZONE, 1, 1)).toBe(true);
    expect(contains(ZONE, 5, 5)).toBe(false);
    expect(contains(ZONE, 31.5, 0.5)).toBe(true);
    expect(contains(ZONE, 20, 5)).toBe(false);
  });

  it("are named in the middle of the largest part", () => expect(middleOf(ZONE)).toEqual([5, 5]));
  it("have bounds", () => expect(boundsOf(ZONE.flat(2))).toEqual([0, 0, 32, 10]));
  it("have an area and a length", () => {
    expect(ringArea(SQUARE)).toBe(100);
    expect(ringArea([...SQUARE].reverse())).toBe(100);
    expect(lineLength(SQUARE)).toBe(40);
  });

  it("say when they cross themselves", () => {
    expect(crossesItself([[0, 0], [10, 0], [10, 10], [0, 10]])).toBe(false);
    expect(crossesItself([[0, 0], [10, 10], [10, 0], [0, 10]])).toBe(true);
    expect(crossesItself([[0, 0], [10, 0], [5, 3]])).toBe(false);
  });

  it("lie on the ground between their corners too", () => {
    const hill = middles((east) => 10 * Math.exp(-(east * east) / 50));
    const line = draped([[-40, 0], [40, 0]], hill, 0.5);
    expect(Math.max(...line.map(([, , up]) => up))).toBeCloseTo(10.5, 1);
    const gaps = line.slice(1).map(([east], k) => east - line[k][0]);
    expect(Math.max(...gaps)).toBeLessThanOrEqual(1 + 1e-9);
  });

  it("have no corners beyond the ground, however long they are", () => {
    const hill = middles((east) => 10 * Math.exp(-(east * east) / 50));
    const line = draped([[-30_000, 0], [30_000, 0], [30_000, 30_000], [-30_000, 0]], hill, 0.5);
    expect(line.length).toBeLessThan(250); // 100 cells of ground twice at most, and the corners
    expect(line.filter(([east]) => Math.abs(east) > 51).length).toBe(4);
    const over = line.filter(([east, north]) => Math.abs(east) <= 50 && north === 0);
    expect(Math.max(...over.map(([, , up]) => up))).toBeCloseTo(10.5, 1);
    expect(Math.max(...over.slice(1).map(([east], k) => east - over[k][0]))).toBeLessThanOrEqual(1 + 1e-9);
  });
});
