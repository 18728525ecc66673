// One function per question that the page asks the service.

import type { Alert, AuditEntry, Corner, Drone, Scene, Timeline, Zone, ZoneHistory, Zones } from "./contract";

/** From the page itself, which a proxy may have put under a path of its own. */
const ROOT = "api/v1";

/** The service said no; `text` is what it said. */
export class Refused extends Error {
  constructor(
    readonly status: number,
    readonly text: string,
  ) {
    super(text);
  }
}

async function answered(response: Response): Promise<Response> {
  if (response.ok) return response;
  throw new Refused(response.status, await refusal(response));
}

async function refusal(response: Response): Promise<string> {
  const said = await response.json().catch(() => null);
  const detail = said?.detail ?? said?.error ?? said?.message;
  if (typeof detail === "string") return detail;
  if (Array.isArray(detail) && typeof detail[0]?.msg === "string") return detail[0].msg;
  return `${response.status} ${response.statusText}`.trim();
}

function address(path: string, query: Record<string, string | null | undefined> = {}): string {
  const given = Object.entries(query).filter((pair): pair is [string, string] => pair[1] != null);
  return `${ROOT}${path}${given.length ? `?${new URLSearchParams(given)}` : ""}`;
}

async function get<T>(url: string): Promise<T> {
  return (await answered(await fetch(url))).json();
}

async function post<T>(url: string, body: unknown): Promise<T> {
  const sent = { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body) };
  const answer = await answered(await fetch(url, sent));
  return answer.status === 204 ? (undefined as T) : answer.json();
}

async function bytes(url: string): Promise<ArrayBuffer> {
  return (await answered(await fetch(url))).arrayBuffer();
}

export type At = string | null;

/** Whether the service knows who asks. Throws where it does not answer. */
export async function isKnown(): Promise<boolean> {
  return (await fetch(address("/me"))).status !== 401;
}

export const scene = () => get<Scene>(address("/scene"));
export const terrain = (run: string) => bytes(address("/terrain", { run }));
export const belief = (at: At) => bytes(address("/belief", { at }));
/** Zones of others may be left out. */
export const zones = (at: At, withStatic: boolean) =>
  get<Zones>(address("/zones", { at, without_static: withStatic ? null : "*" }));
export const zoneHistory = (id: string, at: At) =>
  get<ZoneHistory>(address(`/zones/${encodeURIComponent(id)}/history`, { at }));
export const drones = async (at: At) => (await get<{ drones: Drone[] }>(address("/drones", { at }))).drones;
export const timeline = () => get<Timeline>(address("/timeline"));
export const alerts = async () => (await get<{ alerts: Alert[] }>(address("/alerts"))).alerts;
export const audit = async () => (await get<{ entries: AuditEntry[] }>(address("/audit"))).entries;

export const acknowledge = (id: string) =>
  post<unknown>(address(`/alerts/${encodeURIComponent(id)}/acknowledge`), {});
export const addZone = (polygon: Corner[], reason: string, restriction: string) =>
  post<Zone>(address("/zones"), { polygon, reason, restriction });
export type ZoneAction = "lock" | "unlock" | "dismiss";
/** `more`: for a dismissal the stamp of the moment in which the zone was looked at (`seen_ns`). */
export const actOnZone = (id: string, action: ZoneAction, reason: string, more: Record<string, string> = {}) =>
  post<unknown>(address(`/zones/${encodeURIComponent(id)}/${action}`), { reason, ...more });
export type DroneAction = "leave-out" | "take-in";
export const actOnDrone = (name: string, action: DroneAction, reason: string) =>
  post<unknown>(address(`/drones/${encodeURIComponent(name)}/${action}`), { reason });

export const pictureAddress = (drone: string, at: At) =>
  address(`/drones/${encodeURIComponent(drone)}/picture`, { at });
export const heatmapAddress = (drone: string, at: At) =>
  address(`/drones/${encodeURIComponent(drone)}/heatmap`, { at });
export const baseMapAddress = (run: string) => address("/base-map", { run });
export const baseMapPictureAddress = (run: string, [west, south, east, north]: readonly number[], rows: number, columns: number) =>
  address("/base-map/picture", { run, ...Object.fromEntries(Object.entries({ west, south, east, north, rows, columns }).map(([name, value]) => [name, String(value)])) });
export const exportAddress = (format: string, at: At, more: Record<string, string> = {}) =>
  address("/export", { format, at, ...more });

/** A picture or null; pictures are optional and their absence is shown, not thrown. */
export async function image(url: string): Promise<ImageBitmap | null> {
  return (await stampedImage(url))?.bitmap ?? null;
}

/** What a camera showed, and when: of the moment asked for, or the last one before it. */
export interface StampedImage {
  bitmap: ImageBitmap;
  stamp_ns: string;
}

export async function stampedImage(url: string): Promise<StampedImage | null> {
  try {
    const answer = await fetch(url);
    if (!answer.ok) return null;
    return { bitmap: await createImageBitmap(await answer.blob()), stamp_ns: answer.headers.get("x-crowdfence-stamp-ns") ?? "0" };
  } catch {
    return null;
  }
}
