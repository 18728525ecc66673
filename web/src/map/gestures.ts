// Mouse, touch and wheel -> camera. Dragging carries the ground under the pointer, whatever the hills.

import { bounded, carried, groundUnder, settled, viewportOf, type Camera, type Size } from "./camera";
import type { Heights } from "./heights";

const CLICK_PIXELS = 5;
const DEGREES_PER_PIXEL = 0.3;

export interface Handler {
  camera(): Camera;
  size(): Size;
  heights(): Heights | null;
  onCamera(camera: Camera): void;
  onClick(x: number, y: number): void;
  onDoubleClick(x: number, y: number): void;
  onHover(x: number, y: number): void;
  onLeave(): void;
}

interface Finger {
  x: number;
  y: number;
}

export function listen(element: HTMLElement, handler: Handler): () => void {
  const fingers = new Map<number, Finger>();
  let anchor: readonly number[] | null = null;
  let turning = false;
  let moved = 0;

  const at = (event: MouseEvent): Finger => {
    const box = element.getBoundingClientRect();
    return { x: event.clientX - box.left, y: event.clientY - box.top };
  };
  const take = (finger: Finger) => {
    const heights = handler.heights();
    const camera = handler.camera();
    anchor = heights && groundUnder(viewportOf(camera, handler.size()), finger.x, finger.y, heights, camera.target[2]);
  };
  const settle = () => {
    const heights = handler.heights();
    if (heights) handler.onCamera(bounded(settled(handler.camera(), handler.size(), heights)));
  };
  const zoomed = (camera: Camera, by: number, finger: Finger, place: readonly number[] | null) => {
    const closer = bounded({ ...camera, zoom: camera.zoom + by });
    return place ? carried(closer, handler.size(), place, finger.x, finger.y) : closer;
  };

  const down = (event: PointerEvent) => {
    element.setPointerCapture(event.pointerId);
    if (fingers.size === 0) {
      settle();
      moved = 0;
      turning = event.button !== 0 || event.ctrlKey || event.shiftKey || event.metaKey;
    }
    fingers.set(event.pointerId, at(event));
    take(middle([...fingers.values()]));
  };
  const move = (event: PointerEvent) => {
    const now = at(event);
    const before = fingers.get(event.pointerId);
    if (!before) return handler.onHover(now.x, now.y);
    moved += Math.hypot(now.x - before.x, now.y - before.y);
    if (fingers.size === 1 && moved < CLICK_PIXELS) return;
    const old = [...fingers.values()];
    fingers.set(event.pointerId, now);
    const held = [...fingers.values()];
    const camera = handler.camera();
    if (held.length === 2) return handler.onCamera(pinched(camera, old, held));
    if (turning) return handler.onCamera(turned(camera, now.x - before.x, now.y - before.y));
    if (anchor) handler.onCamera(carried(camera, handler.size(), anchor, now.x, now.y));
  };
  const pinched = (camera: Camera, old: Finger[], held: Finger[]) => {
    const [a, b] = [span(old), span(held)];
    const turn = ((b.angle - a.angle) * 180) / Math.PI;
    const spun = { ...camera, rotationOrbit: camera.rotationOrbit + (Math.abs(turn) < 30 ? turn : 0) };
    return zoomed(spun, Math.log2(b.length / a.length), middle(held), anchor);
  };
  const up = (event: PointerEvent) => {
    const held = fingers.delete(event.pointerId);
    if (fingers.size > 0) return take(middle([...fingers.values()]));
    if (!held) return;
    if (moved >= CLICK_PIXELS) return settle();
    const { x, y } = at(event);
    if (!turning) handler.onClick(x, y);
  };
  const wheel = (event: WheelEvent) => {
    event.preventDefault();
    const finger = at(event);
    take(finger);
    const lines = event.deltaMode === 1 ? 33 : 1;
    const by = Math.min(Math.max((-event.deltaY * lines) / 400, -1), 1);
    handler.onCamera(zoomed(handler.camera(), by, finger, anchor));
  };
  const double = (event: MouseEvent) => {
    const { x, y } = at(event);
    handler.onDoubleClick(x, y);
  };
  const menu = (event: Event) => event.preventDefault();

  element.addEventListener("pointerdown", down);
  element.addEventListener("pointermove", move);
  element.addEventListener("pointerup", up);
  element.addEventListener("pointercancel", up);
  element.addEventListener("pointerleave", handler.onLeave);
  element.addEventListener("wheel", wheel, { passive: false });
  element.addEventListener("dblclick", double);
  element.addEventListener("contextmenu", menu);
  return () => {
    element.removeEventListener("pointerdown", down);
    element.removeEventListener("pointermove", move);
    element.removeEventListener("pointerup", up);
    element.removeEventListener("pointercancel", up);
    element.removeEventListener("pointerleave", handler.onLeave);
    element.removeEventListener("wheel", wheel);
    element.removeEventListener("dblclick", double);
    element.removeEventListener("contextmenu", menu);
  };
}

/** Dragging to the right turns the ground with the pointer; dragging down looks more steeply. */
export function turned(camera: Camera, right: number, down: number): Camera {
  return bounded({
    ...camera,
    rotationOrbit: camera.rotationOrbit + right * DEGREES_PER_PIXEL,
    rotationX: camera.rotationX + down * DEGREES_PER_PIXEL,
  });
}

function middle(fingers: Finger[]): Finger {
  const sum = fingers.reduce((a, b) => ({ x: a.x + b.x, y: a.y + b.y }));
  return { x: sum.x / fingers.length, y: sum.y / fingers.length };
}

function span([a, b]: Finger[]): { length: number; angle: number } {
  return { length: Math.max(Math.hypot(b.x - a.x, b.y - a.y), 1), angle: Math.atan2(b.y - a.y, b.x - a.x) };
}
