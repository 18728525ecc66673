// The map with what lies over it: labels, tools, what is under the pointer, camera pictures.

import { useEffect, useRef, useState } from "preact/hooks";
import type { Zone } from "../api/contract";
import { BeliefIndex, VoxelState, type Reading } from "../map/belief";
import type { Viewport } from "../map/camera";
import { crossesItself, middleOf, ringArea } from "../map/geometry";
import { byWeight, labelOffsets } from "../map/label_places";
import { MapView, type Pointed } from "../map/map_view";
import { renderer } from "../map/renderer";
import { isNarrow, select } from "../state/session";
import { standingOf } from "../state/standing";
import { store, useStore, type State } from "../state/store";
import { older_s, staleAfter_s } from "../state/time";
import { closureOf } from "../text/closure";
import { duration } from "../text/stamp";
import { area, height, place, probability } from "../text/units";
import { STATE_WORDS } from "../text/words";
import { Icon, type IconName } from "./icons";
import { useTold } from "./now";
import { CameraStrip } from "./camera_strip";
import { askForZone, mayOperate } from "./operator";
import { Banner } from "./banner";
import { ScaleBar } from "./scale_bar";

let shown: MapView | null = null;
export const map = () => shown;

const DRAW_AGAIN_MS = 2000;

export function MapPanel() {
  const parent = useRef<HTMLDivElement>(null);
  const labels = useRef<HTMLDivElement>(null);
  const [pointed, setPointed] = useState<Pointed | null>(null);
  const [pixel_m, setPixel] = useState(0);
  const drawing = useStore((state) => state.drawing);
  const pictures = useStore((state) => state.layers.pictures);
  const blank = useStore((state) => state.blank);
  useEffect(() => {
    let timer: number | undefined;
    const begin = () => {
      const drawnBy = renderer();
      store.set({ blank: drawnBy === null });
      if (drawnBy === null) {
        timer = window.setTimeout(begin, DRAW_AGAIN_MS);
        return;
      }
      const view = new MapView(parent.current!, store, drawnBy, select);
      shown = view;
      view.onPoint = setPointed;
      view.onFrame = (viewport) => {
        placeLabels(labels.current, viewport);
        const { camera } = store.state;
        if (camera) setPixel(1 / 2 ** camera.zoom);
      };
      view.onDraw = (corner) => store.set({ drawing: [...(store.state.drawing ?? []), corner] });
      view.onDrawEnd = endDrawing;
      view.onLost = () => {
        end();
        store.set({ blank: true });
        timer = window.setTimeout(begin, DRAW_AGAIN_MS);
      };
    };
    const end = () => {
      window.clearTimeout(timer);
      shown?.end();
      shown = null;
    };
    begin();
    return end;
  }, []);
  return (
    <main class={`map ${drawing ? "drawing" : ""}`}>
      <div ref={parent} class="canvas" data-test="map" tabIndex={0} role="application" aria-label="Map of what is known of the ground" />
      <div ref={labels} class="labels">{!blank && <Labels />}</div>
      {blank && <Blank />}
      <Banner />
      <Tools />
      <Waiting />
      {drawing && <DrawBar />}
      <div class="map-foot">
        <PointedAt pointed={drawing ? null : pointed} />
        <span class="map-corner">
          <Attribution />
          <ScaleBar pixel_m={pixel_m} />
        </span>
        {pictures && <CameraStrip />}
      </div>
    </main>
  );
}

/** Whom the base map is from. */
function Attribution() {
  const attribution = useStore((state) => state.attribution);
  const shown = useStore((state) => state.layers.base);
  return attribution && shown ? <small class="attribution">{attribution}</small> : null;
}

const MARKER_PIXELS = 18;

/** In the order in which they choose their room: what is selected, then as they are listed. */
function placeLabels(parent: HTMLDivElement | null, viewport: Viewport): void {
  const markers = (store.state.moment?.drones ?? []).flatMap(({ position }) => {
    if (!position) return [];
    const [x, y] = viewport.project(position);
    return [{ x, y, width: MARKER_PIXELS, height: MARKER_PIXELS }];
  });
  const labels = [".label.chosen", ".label:not(.chosen)"].flatMap((which) => [...(parent?.querySelectorAll<HTMLElement>(which) ?? [])]);
  const seen = labels.flatMap((label) => {
    const [x, y, depth] = viewport.project(label.dataset.place!.split(",").map(Number));
    const visible = depth > 0 && depth < 1 && x > -40 && y > -40 && x < viewport.width + 40 && y < viewport.height + 40;
    label.hidden = !visible;
    return visible ? [{ label, x, y }] : [];
  });
  const boxes = seen.map(({ label, x, y }) => {
    const { offsetTop, offsetWidth: width, offsetHeight: height } = label.firstElementChild as HTMLElement;
    return { x, y: y + offsetTop + height / 2, width, height };
  });
  labelOffsets(boxes, markers).forEach((offset, k) => {
    const { label, x, y } = seen[k];
    label.style.visibility = offset ? "" : "hidden"; // its size can still be measured
    if (offset) label.style.transform = `translate(${(x + offset[0]).toFixed(1)}px, ${(y + offset[1]).toFixed(1)}px)`;
  });
}

/** By zone, of those that have one. */
function countDownsOf(zones: readonly Zone[], now_ms: number): Record<string, string> {
  const closures = zones.map((zone) => [zone.id, closureOf(zone, now_ms)] as const);
  return Object.fromEntries(closures.flatMap(([id, { end, counts }]) => (counts ? [[id, end]] : [])));
}

function Labels() {
  const moment = useStore((state) => state.moment);
  const countDowns = useTold((now) => countDownsOf(moment?.zones.zones ?? [], now));
  const heights = useStore((state) => state.heights);
  const layers = useStore((state) => state.layers);
  const selection = useStore((state) => state.selection);
  useEffect(() => {
    const parent = document.querySelector<HTMLDivElement>(".labels");
    if (shown) placeLabels(parent, shown.viewport);
  });
  if (!layers.labels || !moment || !heights) return null;
  return (
    <>
      {layers.zones &&
        byWeight(moment.zones.zones).map((zone) => {
          const [east, north] = middleOf(zone.polygon);
          const up = heights.at(east, north);
          const chosen = selection?.kind === "zone" && selection.id === zone.id;
          return (
            <button key={`zone-${zone.id}`} class={`label zone-label kind-${zone.kind} ${chosen ? "chosen" : ""}`} data-place={`${east},${north},${(up === up ? up : 0) + 8}`} onClick={() => select({ kind: "zone", id: zone.id })} hidden>
              <span>
                {zone.locked && <Icon name="lock" size={11} />}
                <b>{zone.id}</b>
                {zone.probability_max !== null && <i>{probability(zone.probability_max)}</i>}
                {countDowns[zone.id] && <i class="count-down">{countDowns[zone.id]}</i>}
              </span>
            </button>
          );
        })}
      {layers.tracks &&
        moment.drones.map(
          (one) =>
            one.position && (
              <button key={`drone-${one.drone}`} class={`label drone-label ${standingOf(one)} ${selection?.kind === "drone" && selection.id === one.drone ? "chosen" : ""}`} data-place={one.position.join(",")} title={one.drone} onClick={() => select({ kind: "drone", id: one.drone })} hidden>
                <span>{one.drone}</span>
              </button>
            ),
        )}
    </>
  );
}

function Tools() {
  const camera = useStore((state) => state.camera);
  const drawing = useStore((state) => state.drawing);
  const sides = useStore((state) => state.sides);
  const scene = useStore((state) => state.scene);
  const operator = mayOperate(scene);
  const tool = (name: IconName, title: string, act: () => void, on = false) => (
    <button class={`square ${on ? "on" : ""}`} title={title} aria-label={title} onClick={act}>
      <Icon name={name} />
    </button>
  );
  const top = (camera?.rotationX ?? 0) > 80;
  return (
    <div class="tools">
      <div class="tool-group">
        {tool("plus", "Closer (+)", () => map()?.zoomBy(0.7))}
        {tool("minus", "Farther (−)", () => map()?.zoomBy(-0.7))}
      </div>
      <div class="tool-group">
        <button class="square" title="North up (N)" aria-label="North up" onClick={() => map()?.northUp()}>
          <span style={{ transform: `rotate(${camera?.rotationOrbit ?? 0}deg)` }} class="needle">
            <Icon name="north" />
          </span>
        </button>
        {tool("tilt", "From above (T)", () => map()?.tiltTo(top ? 45 : 90), top)}
        {tool("home", "Show everything (Home)", () => map()?.showAll())}
      </div>
      <div class="tool-group">
        <button class={`square ${drawing ? "on" : ""}`} disabled={!operator} title={operator ? "Close ground: draw its outline (D)" : "Closing ground needs the role operator"} aria-label="Close ground" onClick={() => store.set({ drawing: drawing ? null : [] })} data-test="draw">
          <Icon name="draw" />
        </button>
      </div>
      <div class="tool-group">{tool("layers", "Side panels ([ and ])", () => store.set({ sides: sides.left || sides.right ? { left: false, right: false } : { left: true, right: !isNarrow() } }), sides.left || sides.right)}</div>
    </div>
  );
}

export function endDrawing(): void {
  const drawing = store.state.drawing;
  if (!drawing) return;
  const corners = drawing.filter((corner, k) => k === 0 || Math.hypot(corner[0] - drawing[k - 1][0], corner[1] - drawing[k - 1][1]) > 0.2);
  if (corners.length < 3 || crossesItself(corners)) return;
  store.set({ drawing: null });
  void askForZone(corners);
}

function DrawBar() {
  const drawing = useStore((state) => state.drawing) ?? [];
  const units = useStore((state) => state.units);
  const crossed = crossesItself(drawing);
  return (
    <div class="draw-bar">
      <b>Close ground</b>
      <span class={crossed ? "bad" : ""}>
        {drawing.length === 0 ? "Click the corners of the ground to close." : crossed ? "The outline crosses itself." : `${drawing.length} corners${drawing.length > 2 ? `, ${area(ringArea(drawing), units)}` : ""}`}
      </span>
      <button onClick={() => store.set({ drawing: drawing.slice(0, -1) })} disabled={!drawing.length}>
        Undo <kbd>⌫</kbd>
      </button>
      <button onClick={() => store.set({ drawing: null })}>
        Cancel <kbd>Esc</kbd>
      </button>
      <button class="primary" onClick={endDrawing} disabled={drawing.length < 3 || crossed} data-test="draw-done">
        Done <kbd>↵</kbd>
      </button>
    </div>
  );
}

let index: BeliefIndex | null = null;

export const reading = (state: State): Reading => ({ older_s: older_s(state), stale_after_s: staleAfter_s(state) });

export function groundAt(east: number, north: number) {
  const { belief } = store.state;
  if (!belief) return null;
  if (index?.belief !== belief) index = new BeliefIndex(belief);
  return index.at(east, north, reading(store.state));
}

function PointedAt({ pointed }: { pointed: Pointed | null }) {
  useStore((state) => state.older_s);
  const units = useStore((state) => state.units);
  const scene = useStore((state) => state.scene);
  const heights = useStore((state) => state.heights);
  if (!pointed || !scene || !heights) return <div class="pointed" />;
  const [east, north] = pointed.place;
  if (Number.isNaN(heights.at(east, north))) return <div class="pointed">no ground in the map</div>;
  const ground = groundAt(east, north);
  return (
    <div class="pointed">
      {ground && <b class={ground.state === VoxelState.crowd ? "bad" : ""}>{STATE_WORDS[ground.state]}</b>}
      {ground?.probability !== null && ground && <span>P {probability(ground.probability)}</span>}
      {ground && ground.age_s !== null && <span>{duration(ground.age_s)} ago</span>}
      <span>{place(east, north, scene.anchor, units)}</span>
      <span>{height(pointed.place, scene.anchor, units)}</span>
    </div>
  );
}

/** A map without ground and zones looks like one on which nothing is closed. */
function Blank() {
  return (
    <div class="waiting" role="alert" data-test="blank">
      <Icon name="warning" size={28} />
      <b>The browser does not draw the map.</b>
      <span>It has no WebGL 2, or its graphics driver has stopped. It is tried again. What is closed is in the list of zones: an empty map is no all-clear.</span>
    </div>
  );
}

function Waiting() {
  const connected = useStore((state) => state.connected);
  const blank = useStore((state) => state.blank);
  const failure = useStore((state) => state.failure);
  const moment = useStore((state) => state.moment);
  const drapes = useStore((state) => state.drapes);
  const scene = useStore((state) => state.scene);
  if (failure) {
    return (
      <div class="waiting">
        <Icon name="warning" size={28} />
        <b>{failure}</b>
        <span>Trying again. Until then this page knows nothing: do not take it for an all-clear.</span>
      </div>
    );
  }
  if (moment && (drapes > 0 || blank)) return null;
  if (scene && !moment && !connected) {
    return (
      <div class="waiting" data-test="unheard">
        <span class="spinner" />
        <b>Waiting for the stream of the service</b>
        <span>
          Until it is there this page knows neither zones nor drones: do not take it for an all-clear. Where it stays so, a proxy before the
          service lets no WebSockets through.
        </span>
      </div>
    );
  }
  return (
    <div class="waiting">
      <span class="spinner" />
      <b>{moment ? "Drawing the map" : scene ? "Waiting for the first views" : "Loading the mission"}</b>
      {scene && !moment && <span>Nothing has been seen yet. Unseen ground is not safe ground.</span>}
    </div>
  );
}
