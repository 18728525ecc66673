// The map: deck.gl draws what the store holds.

import { COORDINATE_SYSTEM, Deck, type Layer } from "@deck.gl/core";
import { PathLayer, ScatterplotLayer } from "@deck.gl/layers";
import type { Drone, Outline, Place, Zone } from "../api/contract";
import { standingOf } from "../state/standing";
import type { State, Store } from "../state/store";
import { older_s, staleAfter_s } from "../state/time";
import { bounded, groundUnder, overview, viewportOf, VIEW, type Camera, type Size, type Viewport } from "./camera";
import { css, droneColour, PALETTES, type Palette, type Rgb } from "./colours";
import { BaseMap } from "./base_map";
import { curtainMesh } from "./curtain";
import { drapeCanvas, drapeFrame, groundPixels, paintAreas, paintBelief, type Area, type DrapeFrame } from "./drape";
import { boundsOf, contains, cornersOf, draped, groundOf, onMap, type Bounds } from "./geometry";
import { listen } from "./gestures";
import type { Heights } from "./heights";
import { Kept } from "./kept";
import type { Renderer } from "./renderer";
import { skirtMesh, terrainMesh, type Mesh } from "./terrain_mesh";
import { UnlitMeshLayer } from "./unlit_mesh_layer";

const ABOVE_GROUND_M = 0.7;
/** Of the longer side of the ground, within bounds: walls say where, not how high. */
const WALL_SHARE = 0.08;
const WALL_M = [6, 26] as const;
/** Software rendering uploads a drape in some 50 ms. */
const DRAPE_EVERY_MS = 250;
const FLY_MS = 450;
/** Of ground that is closed for another reason than crowd. */
const OTHER_ALPHA = 0.22;

interface Ground {
  whole: Heights;
  shown: Heights;
  mesh: Mesh;
  skirt: Mesh;
  floor_m: number;
  frame: DrapeFrame;
  bounds: Bounds;
}

export interface Pointed {
  x: number;
  y: number;
  place: [number, number, number];
}

interface ZoneLine {
  path: Place[];
  colour: Rgb;
  width: number;
}

/** Drawn by people, not by the service: they come after all others. */
const isGiven = ({ kind }: Zone) => kind === "operator" || kind === "static";

export class MapView {
  private deck: Deck<typeof VIEW>;
  private size: Size;
  private ground: Ground | null = null;
  private base: { palette: Palette; seen: Uint8ClampedArray<ArrayBuffer>; unseen: Uint8ClampedArray<ArrayBuffer> } | null = null;
  private readonly surroundings: BaseMap;
  private texture: ImageBitmap | null = null;
  private drapeTimer: number | undefined;
  private drapedAt = -Infinity;
  private seen: State;
  private flight: number | undefined;
  private ended: (() => void)[] = [];
  private wallTextures = new Map<string, ImageData>();
  private readonly lines = { own: new Kept<ZoneLine[]>(), given: new Kept<ZoneLine[]>() };
  private readonly given = new Kept<OffscreenCanvas>();
  private readonly walls = { crowd: new Kept<Mesh | null>(), other: new Kept<Mesh | null>() };
  /** Called after every change of what is where on the screen. */
  onFrame: (viewport: Viewport) => void = () => {};
  onPoint: (pointed: Pointed | null) => void = () => {};
  /** Called with the ground that was clicked, before anything is selected there. */
  onDraw: (place: [number, number]) => void = () => {};
  onDrawEnd: () => void = () => {};
  /** The browser took away what the map is drawn with, and will not give it back: this view stays blank. */
  onLost: () => void = () => {};

  constructor(
    private readonly parent: HTMLDivElement,
    private readonly store: Store,
    private readonly renderer: Renderer,
    private readonly onSelect: (selection: State["selection"]) => void,
  ) {
    this.seen = store.state;
    this.size = { width: parent.clientWidth || 1, height: parent.clientHeight || 1 };
    this.deck = new Deck({
      parent,
      views: VIEW,
      controller: false,
      viewState: this.camera,
      layers: [],
      deviceProps: { type: "webgl", webgl: { antialias: renderer.antialias } },
      useDevicePixels: Math.min(window.devicePixelRatio || 1, 2),
      style: { position: "absolute", inset: "0" },
      onResize: (size) => {
        this.size = size;
        this.redraw();
      },
      onAfterRender: () => this.onFrame(this.viewport),
    });
    this.surroundings = new BaseMap(store, () => {
      this.base = null;
      this.drapeSoon();
    });
    this.ended.push(store.subscribe((state) => this.update(state)));
    this.ended.push(
      listen(parent, {
        camera: () => this.camera,
        size: () => this.size,
        heights: () => this.ground?.shown ?? null,
        onCamera: (camera) => this.moved(camera),
        onClick: (x, y) => this.clicked(x, y),
        onDoubleClick: (x, y) => this.doubleClicked(x, y),
        onHover: (x, y) => this.hovered(x, y),
        onLeave: () => this.onPoint(null),
      }),
    );
    const lost = () => this.onLost();
    parent.addEventListener("webglcontextlost", lost, true); // of the canvas inside
    this.ended.push(() => parent.removeEventListener("webglcontextlost", lost, true));
    this.update(store.state);
  }

  end(): void {
    for (const end of this.ended) end();
    window.clearTimeout(this.drapeTimer);
    window.cancelAnimationFrame(this.flight ?? 0);
    this.deck.finalize();
    this.parent.replaceChildren();
  }

  get viewport(): Viewport {
    return viewportOf(this.camera, this.size);
  }

  private get camera(): Camera {
    return this.store.state.camera ?? { target: [0, 0, 0], zoom: 1, rotationX: 45, rotationOrbit: 0 };
  }

  private get palette(): Palette {
    return PALETTES[this.store.state.theme];
  }

  // -------------------------------------------------------------- where one looks from

  private moved(camera: Camera): void {
    window.cancelAnimationFrame(this.flight ?? 0);
    this.store.set({ camera: bounded(camera), following_drone: null });
  }

  zoomBy(by: number): void {
    this.fly({ ...this.camera, zoom: this.camera.zoom + by });
  }

  northUp(): void {
    this.fly({ ...this.camera, rotationOrbit: 0 });
  }

  tiltTo(rotationX: number): void {
    this.fly({ ...this.camera, rotationX });
  }

  showAll(): void {
    if (this.ground) this.fly(overview(this.interesting(), this.size, this.ground.shown));
  }

  /** Shows ground near the middle, as large as it fits well; of what is larger than the map the part on it. */
  flyTo(bounds: Bounds): void {
    if (!this.ground) return;
    const [west, south, east, north] = onMap(bounds, this.ground.bounds) ?? bounds;
    const margin = Math.max(east - west, north - south, 30) * 0.9;
    const wide: Bounds = [west - margin, south - margin, east + margin, north + margin];
    const { rotationOrbit, rotationX } = this.camera;
    this.fly(overview(wide, this.size, this.ground.shown, rotationOrbit, Math.max(rotationX, 30)));
  }

  private fly(to: Camera): void {
    window.cancelAnimationFrame(this.flight ?? 0);
    const from = this.camera;
    const goal = bounded(to);
    const turn = ((goal.rotationOrbit - from.rotationOrbit + 540) % 360) - 180;
    const still = window.matchMedia("(prefers-reduced-motion: reduce)").matches;
    const started = performance.now();
    const frame = () => {
      const share = still ? 1 : Math.min((performance.now() - started) / FLY_MS, 1);
      const eased = share * share * (3 - 2 * share);
      const between = (a: number, b: number) => a + (b - a) * eased;
      this.store.set({
        camera: bounded({
          target: [0, 1, 2].map((k) => between(from.target[k], goal.target[k])) as Camera["target"],
          zoom: between(from.zoom, goal.zoom),
          rotationX: between(from.rotationX, goal.rotationX),
          rotationOrbit: from.rotationOrbit + turn * eased,
        }),
      });
      if (share < 1) this.flight = window.requestAnimationFrame(frame);
    };
    frame();
  }

  /** Ground with something on it; the whole map where there is nothing. */
  private interesting(): Bounds {
    const { moment, scene } = this.store.state;
    const map = scene?.bounds ?? ([-100, -100, 100, 100] as Bounds);
    const points: (readonly number[])[] = [];
    for (const zone of moment?.zones.zones ?? []) {
      const bounds = boundsOf(cornersOf(zone.polygon));
      // A control zone around the map would leave a dot of the map; one beside it is not what drones look at.
      const shown = bounds && onMap(bounds, map);
      if (shown) points.push([shown[0], shown[1]], [shown[2], shown[3]]);
    }
    for (const drone of moment?.drones ?? []) if (drone.position) points.push(drone.position);
    return groundOf(points, map);
  }

  // -------------------------------------------------------------- pointer

  private pointed(x: number, y: number): [number, number, number] | null {
    if (!this.ground) return null;
    return groundUnder(this.viewport, x, y, this.ground.shown, this.camera.target[2]);
  }

  private hovered(x: number, y: number): void {
    const place = this.pointed(x, y);
    this.onPoint(place && { x, y, place });
  }

  private clicked(x: number, y: number): void {
    const place = this.pointed(x, y);
    if (!place) return;
    if (this.store.state.drawing) return this.onDraw([place[0], place[1]]);
    const drone = this.droneNear(x, y);
    if (drone) return this.onSelect({ kind: "drone", id: drone });
    const zone = this.zoneAt(place[0], place[1]);
    this.onSelect(zone ? { kind: "zone", id: zone.id } : { kind: "ground", east: place[0], north: place[1] });
  }

  private doubleClicked(x: number, y: number): void {
    if (this.store.state.drawing) return this.onDrawEnd();
    const place = this.pointed(x, y);
    if (place) this.fly({ ...this.camera, target: place, zoom: this.camera.zoom + 1 });
  }

  private droneNear(x: number, y: number): string | null {
    const viewport = this.viewport;
    for (const { drone, position } of this.store.state.moment?.drones ?? []) {
      if (!position) continue;
      const [u, v] = viewport.project(position);
      if (Math.hypot(u - x, v - y) < 16) return drone;
    }
    return null;
  }

  /** The smallest zone there, so that one inside another can be reached. */
  private zoneAt(east: number, north: number): Zone | null {
    const there = (this.store.state.moment?.zones.zones ?? []).filter((zone) => contains(zone.polygon, east, north));
    return there.sort((a, b) => a.closed_m2 - b.closed_m2)[0] ?? null;
  }

  // -------------------------------------------------------------- what is drawn

  private update(state: State): void {
    const before = this.seen;
    this.seen = state;
    if (state.heights && state.heights !== this.ground?.whole) this.setGround(state.heights);
    if (!state.camera && this.ground && state.moment) {
      this.store.set({ camera: overview(this.interesting(), this.size, this.ground.shown) });
      return;
    }
    this.follow(state, before);
    const changed = (...names: (keyof State)[]) => names.some((name) => before[name] !== state[name]);
    if (state.theme !== before.theme || state.layers.base !== before.layers.base) this.base = null;
    if (this.ground && state.scene) this.surroundings.ask(state.scene, this.ground.bounds, this.ground.floor_m, state.theme, state.layers.base);
    if (changed("belief", "older_s", "moment", "layers", "strength", "theme", "selection") || !this.texture) this.drapeSoon();
    if (changed("camera", "moment", "layers", "selection", "theme", "drawing")) this.redraw();
  }

  private follow(state: State, before: State): void {
    if (!state.following_drone || state.moment === before.moment || !state.camera) return;
    const drone = state.moment?.drones.find((one) => one.drone === state.following_drone);
    if (!drone?.position || !this.ground) return;
    const [east, north] = drone.position;
    const up = this.ground.shown.at(east, north);
    const target: Camera["target"] = [east, north, up === up ? up : state.camera.target[2]];
    this.store.set({ camera: { ...state.camera, target } });
  }

  private setGround(whole: Heights): void {
    const { rows, columns } = whole.frame;
    const shown = whole.thinned(Math.ceil(Math.max(rows, columns) / this.renderer.vertices));
    const [lowest, highest] = whole.range_m;
    const floor_m = lowest - Math.max(0.15 * (highest - lowest), 8);
    this.ground = {
      whole,
      shown,
      mesh: terrainMesh(shown),
      skirt: skirtMesh(shown, floor_m),
      floor_m,
      frame: drapeFrame(whole),
      bounds: whole.bounds,
    };
    this.base = null;
    this.drapeSoon();
  }

  private drapeSoon(): void {
    if (this.drapeTimer !== undefined) return;
    const wait = Math.max(this.drapedAt + DRAPE_EVERY_MS - performance.now(), 0);
    this.drapeTimer = window.setTimeout(() => {
      this.drapeTimer = undefined;
      this.drapedAt = performance.now();
      this.drape();
    }, wait);
  }

  private drape(): void {
    const { ground, palette } = this;
    if (!ground) return;
    const state = this.store.state;
    const { width, height } = ground.frame;
    if (!this.base) {
      const [seen, unseen] = groundPixels(ground.whole, ground.frame, palette, state.layers.base ? this.surroundings.pixels(ground.frame, palette) : null);
      this.base = { palette, seen, unseen };
    }
    const shown = state.layers.belief && state.belief;
    const pixels = new Uint8ClampedArray(this.base.unseen);
    if (shown) {
      const { threshold } = state.scene!;
      paintBelief(pixels, this.base.seen, ground.frame, shown, {
        palette,
        threshold: state.moment?.zones.threshold ?? threshold,
        stale_after_s: staleAfter_s(state),
        older_s: older_s(state),
        strength: state.strength,
        byAge: state.layers.age,
      });
    }
    const { canvas, context } = drapeCanvas(ground.frame);
    context.putImageData(new ImageData(pixels, width, height), 0, 0);
    paintAreas(context, ground.frame, this.areas(state));
    const given = (state.layers.zones ? (state.moment?.zones.zones ?? []) : []).filter(isGiven);
    if (given.length) context.drawImage(this.givenAreas(given, ground.frame), 0, 0);
    this.texture = canvas.transferToImageBitmap();
    this.redraw();
    this.store.set({ drapes: state.drapes + 1 });
  }

  private areas(state: State): Area[] {
    const areas: Area[] = [];
    const names = state.scene?.drones ?? [];
    if (state.layers.footprints) {
      for (const one of state.moment?.drones ?? []) {
        const { drone, footprint } = one;
        if (footprint.length < 3) continue;
        const chosen = state.selection?.kind === "drone" && state.selection.id === drone;
        const ring = footprint.map(([east, north]) => [east, north] as [number, number]);
        const alpha = (chosen ? 0.2 : 0.06) * (standingOf(one) === "ok" ? 1 : 0.5);
        areas.push({ outline: [[ring]], fill: droneColour(this.palette, names, drone), alpha, hatched: false });
      }
    }
    if (state.layers.zones) {
      for (const zone of (state.moment?.zones.zones ?? []).filter((zone) => !isGiven(zone))) {
        // The buffer alone is filled: what is known of the crowd stays to be seen.
        const ring: Outline = zone.crowd_outline ? [[...zone.polygon.flat(), ...zone.crowd_outline.flat()]] : zone.polygon;
        areas.push({ outline: ring, fill: this.zoneColour(zone, zone.crowd_outline !== null), alpha: zone.kind === "crowd" ? 0.2 : OTHER_ALPHA, hatched: zone.kind !== "crowd" });
      }
    }
    return areas;
  }

  /** Zones of others lie over all else, and are painted once: there may be thousands, and a drape comes with every moment. */
  private givenAreas(zones: readonly Zone[], frame: DrapeFrame): OffscreenCanvas {
    const outlines = zones.map(({ polygon }) => polygon);
    return this.given.of([frame, this.palette, ...outlines], () => {
      const { canvas, context } = drapeCanvas(frame);
      paintAreas(context, frame, outlines.map((outline) => ({ outline, fill: this.palette.operator, alpha: OTHER_ALPHA, hatched: true })));
      return canvas;
    });
  }

  private zoneColour(zone: Zone, buffer: boolean): Rgb {
    if (isGiven(zone)) return this.palette.operator;
    return buffer || zone.kind === "unseen" ? this.palette.buffer : this.palette.zone;
  }

  private redraw(): void {
    this.deck.setProps({ viewState: this.camera, layers: this.layers() });
  }

  private layers(): Layer[] {
    const { ground, palette } = this;
    const state = this.store.state;
    if (!ground || !this.texture) return [];
    const { layers, selection } = state;
    const names = state.scene?.drones ?? [];
    const drones = (state.moment?.drones ?? []).filter((drone) => drone.position);
    const zones = layers.zones ? (state.moment?.zones.zones ?? []) : [];
    const chosen = selection?.kind === "zone" ? selection.id : null;
    const own = zones.filter((zone) => !isGiven(zone));
    const given = zones.filter(isGiven);
    const meters = { coordinateSystem: COORDINATE_SYSTEM.CARTESIAN } as const;
    const sheet = layers.base ? this.surroundings.sheet : null;
    const drawn: (Layer | null)[] = [
      sheet && new UnlitMeshLayer({ ...meters, id: "surroundings", data: [0], mesh: sheet.mesh as never, texture: sheet.texture as never, textureParameters: { minFilter: "linear", magFilter: "linear", mipmapFilter: "linear", maxAnisotropy: 2 } as never, getPosition: () => [0, 0, 0], getColor: [255, 255, 255] }),
      new UnlitMeshLayer({ ...meters, id: "ground", data: [0], mesh: ground.mesh as never, texture: this.texture as never, textureParameters: { minFilter: "linear", magFilter: "linear", mipmapFilter: "linear", maxAnisotropy: this.renderer.anisotropy } as never, getPosition: () => [0, 0, 0], getColor: [255, 255, 255] }),
      new UnlitMeshLayer({ ...meters, id: "skirt", data: [0], mesh: ground.skirt as never, getPosition: () => [0, 0, 0], getColor: [...palette.skirt, 255], parameters: { cullMode: "none" }, updateTriggers: { getColor: state.theme } }),
      layers.footprints ? this.paths("footprints", drones.filter((one) => one.footprint.length > 2), (one) => draped(one.footprint, ground.shown, ABOVE_GROUND_M), (one) => [...droneColour(palette, names, one.drone), standingOf(one) === "ok" ? 210 : 110], () => 1.5) : null,
      this.zoneLayer("own", own, ground.shown, chosen),
      this.zoneLayer("given", given, ground.shown, chosen),
      ...(layers.walls ? this.wallLayers(zones, ground.shown) : []),
      ...(layers.tracks ? this.droneLayers(drones, ground.shown, names) : []),
      this.drawingLayer(state, ground.shown),
      this.markLayer(state, ground.shown),
    ];
    return drawn.filter((layer): layer is Layer => layer !== null);
  }

  private paths<T>(id: string, data: T[], path: (one: T) => Place[], colour: (one: T) => number[], width: (one: T) => number): Layer {
    return new PathLayer<T>({
      id,
      data,
      coordinateSystem: COORDINATE_SYSTEM.CARTESIAN,
      getPath: path as never,
      getColor: colour as never,
      getWidth: width,
      widthUnits: "pixels",
      jointRounded: true,
      capRounded: true,
      billboard: true,
      parameters: { depthWriteEnabled: false },
    });
  }

  /** Outlines; those of others, which may be thousands and stay as they are, apart from those that change. */
  private zoneLayer(name: "own" | "given", zones: readonly Zone[], heights: Heights, chosen: string | null): Layer {
    const which = zones.some(({ id }) => id === chosen) ? chosen : null;
    const lines = this.lines[name].of([heights, this.palette, which, ...zones], () => zones.flatMap((zone) => this.zoneLines(zone, heights, zone.id === which)));
    return this.paths(`zones-${name}`, lines, (line) => line.path, (line) => [...line.colour, 255], (line) => line.width);
  }

  private zoneLines(zone: Zone, heights: Heights, chosen: boolean): ZoneLine[] {
    const line = (outline: Outline, colour: Rgb, width: number, above_m: number) =>
      outline.flat().map((ring) => ({ path: draped(ring, heights, above_m), colour, width }));
    const outer = this.zoneColour(zone, zone.crowd_outline !== null);
    return [
      ...(chosen ? line(zone.polygon, this.palette.selected, 6, ABOVE_GROUND_M) : []),
      ...line(zone.polygon, outer, chosen ? 3 : 2.2, ABOVE_GROUND_M + 0.2),
      ...(zone.crowd_outline ? line(zone.crowd_outline, this.palette.zone, 1.6, ABOVE_GROUND_M + 0.1) : []),
    ];
  }

  private wallLayers(zones: readonly Zone[], heights: Heights): Layer[] {
    const groups: ["crowd" | "other", Rgb, Zone[]][] = [
      ["crowd", this.palette.zone, zones.filter((zone) => zone.kind === "crowd")],
      ["other", this.palette.operator, zones.filter(isGiven)],
    ];
    return groups.flatMap(([name, colour, group]) => {
      const wall = this.wallMesh(name, group, heights);
      if (!wall) return [];
      return [
        new UnlitMeshLayer({
          id: `walls-${name}`,
          data: [0],
          mesh: wall as never,
          texture: this.wallTexture(colour) as never,
          coordinateSystem: COORDINATE_SYSTEM.CARTESIAN,
          getPosition: () => [0, 0, 0],
          getColor: [255, 255, 255],
          parameters: { cullMode: "none", depthWriteEnabled: false },
        }),
      ];
    });
  }

  private wallMesh(name: "crowd" | "other", zones: readonly Zone[], heights: Heights): Mesh | null {
    const outlines = zones.map(({ polygon }) => polygon);
    return this.walls[name].of([heights, ...outlines], () => curtainMesh(outlines, heights, this.wall_m));
  }

  private get wall_m(): number {
    const [west, south, east, north] = this.ground!.bounds;
    return Math.min(Math.max(WALL_SHARE * Math.max(east - west, north - south), WALL_M[0]), WALL_M[1]);
  }

  private wallTexture(colour: Rgb): ImageData {
    const key = css(colour);
    let texture = this.wallTextures.get(key);
    if (!texture) {
      // Plain bytes: a canvas would multiply the colour with its opacity, and deck.gl does that once more.
      texture = new ImageData(1, 64);
      for (let k = 0; k < 64; k++) texture.data.set([...colour, Math.round(150 * (k / 63) ** 2)], 4 * k);
      this.wallTextures.set(key, texture);
    }
    return texture;
  }

  private droneLayers(drones: Drone[], heights: Heights, names: readonly string[]): Layer[] {
    const colour = (drone: Drone, alpha: number) => [...droneColour(this.palette, names, drone.drone), standingOf(drone) === "ok" ? alpha : alpha * 0.5] as [number, number, number, number];
    const stems = drones.map((drone) => {
      const [east, north, up] = drone.position!;
      const ground = heights.at(east, north);
      return { drone, path: [drone.position!, [east, north, ground === ground ? ground : up]] as Place[] };
    });
    const rays = drones.flatMap((drone) => corners(drone.footprint).map((foot) => ({ drone, path: [drone.position!, foot] as Place[] })));
    const dots = { coordinateSystem: COORDINATE_SYSTEM.CARTESIAN, radiusUnits: "pixels", billboard: true, getPosition: (one: Drone) => one.position! } as const;
    return [
      this.paths("trails", drones.filter((one) => (one.trail?.length ?? 0) > 1), (one) => one.trail!, (one) => colour(one, 190), () => 2),
      this.paths("stems", stems, (one) => one.path, (one) => colour(one.drone, 120), () => 1),
      this.paths("rays", rays, (one) => one.path, (one) => colour(one.drone, 56), () => 1),
      new ScatterplotLayer<Drone>({ ...dots, id: "halo", data: drones, getRadius: 11, getFillColor: (one) => colour(one, 60), parameters: { depthWriteEnabled: false } }),
      new ScatterplotLayer<Drone>({ ...dots, id: "drones", data: drones, getRadius: 5.5, stroked: true, lineWidthUnits: "pixels", getLineWidth: 2, getLineColor: [...this.palette.background, 255], getFillColor: (one) => colour(one, 255) }),
    ];
  }

  private drawingLayer(state: State, heights: Heights): Layer | null {
    if (!state.drawing?.length) return null;
    const ring = [...state.drawing, state.drawing[0]];
    const colour = () => [...this.palette.selected, 255];
    return this.paths("drawing", [ring], (line) => draped(line, heights, 1.5), colour, () => 3);
  }

  private markLayer(state: State, heights: Heights): Layer | null {
    const { selection, drawing } = state;
    const marks: Place[] = (drawing ?? []).map(([east, north]) => [east, north, heights.at(east, north) + 1.5]);
    if (selection?.kind === "ground") marks.push([selection.east, selection.north, heights.at(selection.east, selection.north) + 0.5]);
    if (!marks.length) return null;
    return new ScatterplotLayer<Place>({
      id: "marks",
      data: marks,
      coordinateSystem: COORDINATE_SYSTEM.CARTESIAN,
      getPosition: (place) => place,
      getRadius: 6,
      radiusUnits: "pixels",
      billboard: true,
      filled: true,
      getFillColor: [...this.palette.selected, 60],
      stroked: true,
      lineWidthUnits: "pixels",
      getLineWidth: 2,
      getLineColor: [...this.palette.selected, 255],
      parameters: { depthCompare: "always" },
    });
  }

  /** The map as a picture. */
  picture(): Promise<Blob | null> {
    const canvas = this.parent.querySelector("canvas");
    if (!canvas) return Promise.resolve(null);
    this.deck.redraw("picture"); // a WebGL canvas holds its pixels until the browser has shown them
    return new Promise((resolve) => canvas.toBlob(resolve, "image/png"));
  }
}

/** Four places of a footprint that stand for its corners: the farthest apart in both diagonals. */
function corners(footprint: readonly Place[]): Place[] {
  if (footprint.length < 4) return [];
  const most = (of: (place: Place) => number) => footprint.reduce((a, b) => (of(b) > of(a) ? b : a));
  return [most(([e, n]) => e + n), most(([e, n]) => e - n), most(([e, n]) => n - e), most(([e, n]) => -e - n)];
}
