// Keys; none of them while somebody types, or where the key is for what has the focus.

import { boundsOf, cornersOf } from "../map/geometry";
import { goLive, isNarrow, playOrPause, select, stepBy } from "../state/session";
import { store } from "../state/store";
import { endDrawing, map } from "./map_panel";
import { mayOperate } from "./operator";

export function listenToKeys(): () => void {
  const pressed = (event: KeyboardEvent) => {
    if (event.ctrlKey || event.metaKey || event.altKey || isTaken(event)) return;
    const act = ACTIONS[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (!act) return;
    event.preventDefault();
    act();
  };
  window.addEventListener("keydown", pressed);
  return () => window.removeEventListener("keydown", pressed);
}

function isTaken(event: KeyboardEvent): boolean {
  const at = event.target;
  if (document.querySelector("dialog[open]")) return true;
  if (!(at instanceof HTMLElement)) return false;
  if (at instanceof HTMLTextAreaElement || at instanceof HTMLSelectElement) return true;
  if (at instanceof HTMLInputElement) return OF_INPUTS[at.type]?.includes(event.key) ?? true;
  return (at instanceof HTMLButtonElement && [" ", "Enter"].includes(event.key)) || (at instanceof HTMLAnchorElement && event.key === "Enter");
}

/** What the browser does with keys on inputs that take no words: a key that ticks a box or moves a slider does that alone. */
const OF_INPUTS: Record<string, string[]> = {
  checkbox: [" "],
  range: ["ArrowLeft", "ArrowRight", "Home"],
};

type Panel = NonNullable<typeof store.state.panel>;
const toggle = (panel: Panel) => () => store.set({ panel: store.state.panel === panel ? null : panel });
const side = (name: "left" | "right") => () => {
  const { sides } = store.state;
  const others = isNarrow() ? { left: false, right: false } : sides;
  store.set({ sides: { ...others, [name]: !sides[name] } });
};

function nextZone(by: number): void {
  const { moment, selection } = store.state;
  const zones = moment?.zones.zones ?? [];
  if (!zones.length) return;
  const now = zones.findIndex(({ id }) => selection?.kind === "zone" && id === selection.id);
  const zone = zones[now < 0 ? (by > 0 ? 0 : zones.length - 1) : (now + by + zones.length) % zones.length];
  select({ kind: "zone", id: zone.id });
  const bounds = boundsOf(cornersOf(zone.polygon));
  if (bounds) map()?.flyTo(bounds);
}

function follow(): void {
  const { selection, following_drone, moment } = store.state;
  const drone = selection?.kind === "drone" ? selection.id : moment?.drones[0]?.drone;
  if (drone) store.set({ following_drone: following_drone === drone ? null : drone });
}

function draw(): void {
  if (mayOperate(store.state.scene)) store.set({ drawing: store.state.drawing ? null : [] });
}

function letGo(): void {
  const { panel, drawing, following_drone } = store.state;
  if (panel) store.set({ panel: null });
  else if (drawing) store.set({ drawing: null });
  else if (following_drone) store.set({ following_drone: null });
  else select(null);
}

const ACTIONS: Record<string, () => void> = {
  " ": playOrPause,
  l: goLive,
  ArrowLeft: () => stepBy(-1),
  ArrowRight: () => stepBy(1),
  j: () => nextZone(1),
  k: () => nextZone(-1),
  f: follow,
  n: () => map()?.northUp(),
  t: () => map()?.tiltTo((store.state.camera?.rotationX ?? 0) > 80 ? 45 : 90),
  Home: () => map()?.showAll(),
  "+": () => map()?.zoomBy(0.7),
  "=": () => map()?.zoomBy(0.7),
  "-": () => map()?.zoomBy(-0.7),
  d: draw,
  a: toggle("alerts"),
  e: toggle("export"),
  "?": toggle("help"),
  "[": side("left"),
  "]": side("right"),
  Enter: endDrawing,
  Backspace: () => store.state.drawing && store.set({ drawing: store.state.drawing.slice(0, -1) }),
  Escape: letGo,
};
