// The address after #: which moment, what is selected and from where it is seen, to be handed to somebody else.

import type { Camera } from "../map/camera";
import type { Selection } from "./store";

export interface Link {
  /** Stamp in nanoseconds; null is the newest moment. */
  t: string | null;
  selection: Selection;
  view: Camera | null;
}

const ROUND = [1, 1, 1, 2, 1, 1];

export function formatLink({ t, selection, view }: Link): string {
  const parts: string[] = [];
  if (t) parts.push(`t=${t}`);
  if (selection?.kind === "zone") parts.push(`zone=${encodeURIComponent(selection.id)}`);
  if (selection?.kind === "drone") parts.push(`drone=${encodeURIComponent(selection.id)}`);
  if (selection?.kind === "ground") parts.push(`at=${selection.east.toFixed(1)},${selection.north.toFixed(1)}`);
  if (view) {
    const numbers = [...view.target, view.zoom, view.rotationX, view.rotationOrbit];
    parts.push(`view=${numbers.map((value, k) => String(Number(value.toFixed(ROUND[k])))).join(",")}`);
  }
  return parts.length ? `#${parts.join("&")}` : "";
}

/** What makes no sense is left out; a link never breaks the page. */
export function parseLink(hash: string): Link {
  const given = new URLSearchParams(hash.replace(/^#/, ""));
  const t = given.get("t");
  return {
    t: t !== null && /^\d{1,19}$/.test(t) ? t : null,
    selection: selectionOf(given),
    view: viewOf(given.get("view")),
  };
}

function selectionOf(given: URLSearchParams): Selection {
  const zone = given.get("zone");
  if (zone) return { kind: "zone", id: zone };
  const drone = given.get("drone");
  if (drone) return { kind: "drone", id: drone };
  const place = numbers(given.get("at"), 2);
  return place && { kind: "ground", east: place[0], north: place[1] };
}

function viewOf(text: string | null): Camera | null {
  const given = numbers(text, 6);
  if (!given) return null;
  const [east, north, up, zoom, rotationX, rotationOrbit] = given;
  return { target: [east, north, up], zoom, rotationX, rotationOrbit };
}

function numbers(text: string | null, count: number): number[] | null {
  if (!text) return null;
  const values = text.split(",").map((part) => (part.trim() === "" ? NaN : Number(part)));
  return values.length === count && values.every(Number.isFinite) ? values : null;
}
