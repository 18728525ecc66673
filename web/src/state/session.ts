// What drives the page: the stream while it follows, questions with a stamp while it looks back.

import * as api from "../api/client";
import type { Alert, Drone, Message, Place, Scene, Step, Zones } from "../api/contract";
import { openStream } from "../api/stream";
import { parseBelief } from "../map/belief";
import { Heights } from "../map/heights";
import { indexAt } from "../text/stamp";
import { withAlert } from "./alerts";
import { formatLink, parseLink } from "./deep_link";
import { elapsed_ms } from "./elapsed";
import { keepSettings, readSettings } from "./settings";
import { StaticZones } from "./static_zones";
import { store, type Selection, type Time } from "./store";
import { thinned } from "./thinning";
import { agedDrones, older_s, pointAt, sinceFirst } from "./time";
import { unchanged } from "./unchanged";

const BELIEF_EVERY_MS = 500;
const LONGEST_TRAIL = 2000;
/** Of alerts on the time line. */
const MOST_TICKS = 2000;
const AGE_EVERY_MS = 500;
const REFRESH_AGAIN_MS = 3000;
/** A map that is less old is not drawn anew for its age: while views come, the next one is on its way. */
const OLD_S = 2;

let noticeNumber = 0;

/** What is said again while it is still there stays once. */
export function notify(text: string, level: "info" | "error" = "info"): void {
  const notice = { id: ++noticeNumber, level, text };
  const others = store.state.notices.filter((one) => one.text !== text || one.level !== level);
  store.set({ notices: [...others, notice].slice(-4) });
  window.setTimeout(
    () => store.set({ notices: store.state.notices.filter(({ id }) => id !== notice.id) }),
    level === "error" ? 9000 : 4500,
  );
}

/** The text of an error for people. */
export function reasonOf(error: unknown): string {
  if (error instanceof api.Refused) {
    return error.status === 403 ? `Your role does not allow this: ${error.text}` : error.text;
  }
  return error instanceof TypeError ? "The service does not answer." : String(error);
}

/** Whether panels lie over the map, so that it begins without them and holds one at a time: style.css has the same width. */
export const isNarrow = () => narrow().matches;
const narrow = () => window.matchMedia("(max-width: 860px)");

/** A tablet that is turned has room for other panels than before. */
function keepPanelsApart(): void {
  narrow().addEventListener("change", () => {
    const { sides, selection } = store.state;
    store.set({ sides: isNarrow() ? { left: false, right: sides.right && selection !== null } : { left: true, right: true } });
  });
}

export async function start(): Promise<void> {
  addressed = location.hash;
  const link = parseLink(addressed);
  store.set({ ...readSettings(), selection: link.selection, camera: link.view });
  if (isNarrow()) store.set({ sides: { left: false, right: false } });
  document.documentElement.dataset.theme = store.state.theme;
  try {
    await load();
  } catch (error) {
    store.set({ failure: reasonOf(error) });
    window.setTimeout(start, 3000);
    return;
  }
  store.set({ failure: null });
  openStream({ onMessage, onConnection });
  keepAddress();
  keepPlaying();
  keepAging();
  keepPanelsApart();
  window.addEventListener("hashchange", followAddress);
  if (location.hash !== addressed) followAddress();
  else if (link.t) await showPast(link.t);
}

async function load(): Promise<void> {
  const scene = await api.scene();
  takeScene(scene);
  await hearing(async () => {
    const [terrain, alerts, timeline] = await Promise.all([api.terrain(scene.run), api.alerts(), api.timeline()]);
    const heights = Heights.fromBytes(scene.terrain, terrain);
    store.set({ heights, alerts, timeline });
  });
  document.title = `${scene.name} · crowdfence`;
}

let leaving = false;

/** Another mission at the same address is begun anew: nothing of the one before may be taken for it. */
function takeScene(scene: Scene): void {
  const before = store.state.scene;
  if (before && missionOf(before) !== missionOf(scene)) {
    leaving = true;
    history.replaceState(null, "", location.pathname + location.search);
    location.reload();
  } else store.set({ scene, mode: scene.mode });
}

const missionOf = ({ name, anchor, terrain, method }: Scene) => JSON.stringify([name, anchor, terrain, method]);

// ---------------------------------------------------------------- the newest moment

let newest: Step | null = null;
let newestArrived = 0;
let trails = new Map<string, Place[]>();
let newestBelief: string | number | null = null;
let beliefAsked = false;
let beliefTimer: number | undefined;
let wasConnected = false;
let again: number | undefined;

function onConnection(connected: boolean): void {
  store.set({ connected, ...(connected && { unknown: false }) });
  if (!connected) void api.isKnown().then((known) => store.set({ unknown: !known }), () => {});
  // What happened while the line was dead is asked for; the stream brings only what comes next.
  if (connected) void (wasConnected ? refresh() : askAlerts());
  wasConnected ||= connected;
}

/** Those that were raised since the page asked, before it had a line. */
async function askAlerts(): Promise<void> {
  window.clearTimeout(again);
  try {
    await hearing(async () => store.set({ alerts: await api.alerts() }));
  } catch (error) {
    notify(reasonOf(error), "error");
    again = window.setTimeout(() => store.state.connected && void askAlerts(), REFRESH_AGAIN_MS);
  }
}

async function refresh(): Promise<void> {
  window.clearTimeout(again);
  try {
    newestBelief = null;
    trails = new Map();
    await load();
  } catch (error) {
    notify(reasonOf(error), "error");
    // Alerts and time line are those from before: they are asked for until they are there.
    again = window.setTimeout(() => store.state.connected && void refresh(), REFRESH_AGAIN_MS);
  }
}

function onMessage(message: Message): void {
  switch (message.type) {
    case "hello":
      takeScene(message.scene);
      break;
    case "mode":
      store.set({ mode: message.mode });
      break;
    case "alert":
      takeAlert(message.alert);
      break;
    case "step":
      void takeLeftOut(message);
      break;
  }
}

/** What the stream told since the questions were asked that have no answer yet. */
const heard = new Set<Alert[]>();

/** What the stream tells of alerts while they are asked for is newer than the answer, which does not hold it. */
async function hearing(ask: () => Promise<void>): Promise<void> {
  const meanwhile: Alert[] = [];
  heard.add(meanwhile);
  try {
    await ask();
  } finally {
    heard.delete(meanwhile);
  }
  meanwhile.forEach(takeAlert);
}

function takeAlert(alert: Alert): void {
  for (const meanwhile of heard) meanwhile.push(alert);
  const { timeline } = store.state;
  const known = timeline.alerts.some(({ id }) => id === alert.id);
  const tick = { stamp_ms: alert.raised_ms, id: alert.id, level: alert.level };
  store.set({
    alerts: withAlert(store.state.alerts, alert),
    timeline: known ? timeline : { ...timeline, alerts: [...timeline.alerts.slice(-MOST_TICKS), tick] },
  });
}

const staticZones = new StaticZones();
/** The newest step whose zones of others are being asked for. */
let incomplete: Step | null = null;

/** A step as it comes over the line. What is shown is a moment with all its zones, or the one before. */
async function takeLeftOut(step: Step): Promise<void> {
  const zones = staticZones.whole(step.zones);
  if (zones) {
    incomplete = null;
    return takeStep({ ...step, zones });
  }
  const isAsking = incomplete !== null;
  incomplete = step;
  if (isAsking) return;
  let told: Zones | null = null;
  try {
    told = await zonesOf(step.stamp_ns);
  } catch (error) {
    notify(reasonOf(error), "error");
    await new Promise((resolve) => window.setTimeout(resolve, REFRESH_AGAIN_MS));
  }
  const latest: Step | null = incomplete;
  incomplete = null;
  if (latest === step && told) takeStep({ ...step, zones: told });
  else if (latest) void takeLeftOut(latest);
}

/** All zones of a moment; those of others are asked for where the page lacks them. */
async function zonesOf(at: api.At): Promise<Zones> {
  return staticZones.whole(await api.zones(at, false)) ?? staticZones.whole(await api.zones(at, true))!;
}

function takeStep(step: Step): void {
  newest = step;
  newestArrived = elapsed_ms();
  lengthenTrails(step.drones.drones);
  lengthenTimeline(step);
  if (store.state.time.following) showNewest();
}

function lengthenTrails(drones: readonly Drone[]): void {
  for (const { drone, position } of drones) {
    const trail = trails.get(drone);
    if (!trail || !position) continue;
    const last = trail.at(-1);
    if (last && last.every((value, k) => value === position[k])) continue;
    trails.set(drone, [...trail.slice(-LONGEST_TRAIL), position]);
  }
}

function lengthenTimeline(step: Step): void {
  const { timeline } = store.state;
  const last = timeline.points.at(-1);
  if (last && last.stamp_ms >= step.stamp_ms) return;
  const { stamp_ns, stamp_ms, seen_m2, crowd_m2, closed_m2 } = step;
  const point = { stamp_ns, stamp_ms, seen_m2, crowd_m2, closed_m2, zones: step.zones.zones.length };
  store.set({ timeline: { ...timeline, points: thinned([...timeline.points, point]) } });
}

/** What did not change since the moment shown is not drawn anew. */
function kept(zones: Zones): Zones {
  return { ...zones, zones: unchanged(zones.zones, store.state.moment?.zones.zones ?? []) };
}

function showNewest(): void {
  if (!newest) return;
  const { stamp_ns, stamp_ms, lag_s, silent_s, closed_m2 } = newest;
  const zones = kept(newest.zones);
  const drones = newest.drones.drones.map((drone) => ({ ...drone, trail: trails.get(drone.drone) ?? [] }));
  store.set({ moment: { stamp_ns, stamp_ms, zones, drones, lag_s, silent_s, closed_m2, arrived: newestArrived } });
  if (newest.belief_version !== newestBelief) askBelief();
  if (newest.drones.drones.some(({ drone }) => !trails.has(drone))) void askTrails();
}

/** At most twice a second, and one question at a time. */
function askBelief(): void {
  if (beliefAsked) return;
  beliefAsked = true;
  window.clearTimeout(beliefTimer);
  const asked = newest?.belief_version ?? null;
  api
    .belief(null)
    .then((buffer) => {
      if (!store.state.time.following) return;
      newestBelief = asked;
      store.set({ belief: parseBelief(buffer), belief_arrived: elapsed_ms() });
    })
    .catch((error) => {
      if (!(error instanceof api.Refused && error.status === 404)) notify(reasonOf(error), "error");
    })
    .finally(() => {
      beliefTimer = window.setTimeout(() => {
        beliefAsked = false;
        if (store.state.time.following && newest && newest.belief_version !== newestBelief) askBelief();
      }, BELIEF_EVERY_MS);
    });
}

async function askTrails(): Promise<void> {
  for (const { drone } of newest?.drones.drones ?? []) if (!trails.has(drone)) trails.set(drone, []);
  const drones = await api.drones(null).catch(() => []);
  for (const { drone, trail } of drones) trails.set(drone, trail ?? []);
  if (store.state.time.following) showNewest();
}

/** Silence changes what is shown, and brings no message. */
function keepAging(): void {
  window.setInterval(() => {
    const { state } = store;
    const seconds = Math.floor(older_s(state));
    const older = seconds < OLD_S ? 0 : seconds;
    const drones = agedDrones(state);
    if (older === state.older_s && !drones) return;
    store.set({ older_s: older, ...(drones && { moment: { ...state.moment!, drones } }) });
  }, AGE_EVERY_MS);
}

// ---------------------------------------------------------------- moments of the past

let asking = false;
let wanted: string | null = null;

/** Shows the moment of a stamp; while one is on its way only the newest wish is kept. */
export async function showPast(stamp_ns: string): Promise<void> {
  wanted = stamp_ns;
  const point = store.state.timeline.points.find((one) => one.stamp_ns === stamp_ns);
  const stamp_ms = point?.stamp_ms ?? Number(BigInt(stamp_ns) / 1000n) / 1000;
  setTime({ following: false, stamp_ns, stamp_ms });
  if (asking) return;
  asking = true;
  while (wanted !== null) {
    const stamp: string = wanted;
    wanted = null;
    try {
      const [zones, drones, belief] = await Promise.all([zonesOf(stamp), api.drones(stamp), api.belief(stamp)]);
      if (store.state.time.following) break;
      const arrived = elapsed_ms();
      store.set({
        moment: { stamp_ns: zones.stamp_ns, stamp_ms: zones.stamp_ms, zones: kept(zones), drones, lag_s: null, silent_s: null, closed_m2: pointAt(store.state.timeline.points, zones.stamp_ns)?.closed_m2 ?? null, arrived },
        belief: parseBelief(belief),
        belief_arrived: arrived,
      });
    } catch (error) {
      if (store.state.time.following) break;
      notify(reasonOf(error), "error");
      if (wanted === null) stayAtShown();
    }
  }
  asking = false;
}

/** Where the moment asked for cannot be had, time and exports stay those of what is shown; of a page that shows
 * nothing yet, as one opened by a link to what is no longer kept, those of now. */
function stayAtShown(): void {
  const { moment } = store.state;
  if (!moment) goLive();
  else setTime({ playing: false, stamp_ns: moment.stamp_ns, stamp_ms: moment.stamp_ms });
}

/** The moment at which something happened. */
export function showWhen(stamp_ns: string): void {
  setTime({ playing: false });
  void showPast(sinceFirst(store.state.timeline.points, stamp_ns));
}

function setTime(change: Partial<Time>): void {
  store.set({ time: { ...store.state.time, ...change } });
}

export function goLive(): void {
  wanted = null;
  setTime({ following: true, playing: false, stamp_ns: null, stamp_ms: null });
  newestBelief = null;
  showNewest();
}

/** Pauses what plays or goes on; plays what is paused, and a finished mission from its beginning. */
export function playOrPause(): void {
  const { time, moment, mode } = store.state;
  if (time.following && mode !== "finished") {
    if (moment) void showPast(moment.stamp_ns);
  } else if (time.playing) setTime({ playing: false });
  else play();
}

function play(): void {
  const { points } = store.state.timeline;
  const { stamp_ms } = store.state.time;
  const atEnd = stamp_ms === null || stamp_ms >= (points.at(-1)?.stamp_ms ?? 0);
  if (atEnd && points.length) void showPast(points[0].stamp_ns);
  playhead_ms = atEnd ? (points[0]?.stamp_ms ?? 0) : stamp_ms;
  setTime({ playing: true });
}

export function setSpeed(speed: number): void {
  setTime({ speed });
}

export function seek(stamp_ms: number): void {
  const { points } = store.state.timeline;
  if (!points.length) return;
  const point = points[indexAt(points, stamp_ms)];
  playhead_ms = stamp_ms;
  if (point.stamp_ns !== store.state.time.stamp_ns) void showPast(point.stamp_ns);
}

export function stepBy(count: number): void {
  const { timeline, moment } = store.state;
  if (!timeline.points.length) return;
  const now = indexAt(timeline.points, moment?.stamp_ms ?? Infinity);
  const next = Math.min(Math.max(now + count, 0), timeline.points.length - 1);
  setTime({ playing: false });
  void showPast(timeline.points[next].stamp_ns);
}

let playhead_ms = 0;

function keepPlaying(): void {
  let before = performance.now();
  window.setInterval(() => {
    const now = performance.now();
    const passed_ms = now - before;
    before = now;
    const { time, timeline } = store.state;
    if (!time.playing || !timeline.points.length) return;
    playhead_ms += passed_ms * time.speed;
    const last = timeline.points[timeline.points.length - 1];
    if (playhead_ms >= last.stamp_ms) {
      setTime({ playing: false });
      void showPast(last.stamp_ns);
    } else if (!asking) seek(playhead_ms);
  }, 80);
}

// ---------------------------------------------------------------- what the viewer does

export function select(selection: Selection): void {
  const sides = isNarrow() ? { left: false, right: selection !== null } : { ...store.state.sides, right: true };
  store.set({ selection, sides });
}

export function settle(change: Partial<ReturnType<typeof readSettings>>): void {
  store.set(change);
  const { theme, units, clock } = store.state;
  document.documentElement.dataset.theme = theme;
  keepSettings({ theme, units, clock });
}

export async function acknowledge(...ids: string[]): Promise<void> {
  try {
    for (const id of ids) await api.acknowledge(id);
    await hearing(async () => store.set({ alerts: await api.alerts() }));
  } catch (error) {
    notify(reasonOf(error), "error");
  }
}

/** What an operator did is on the map with the next step; where no step comes, now. */
export async function zonesChanged(): Promise<void> {
  if (!store.state.time.following) return;
  const zones = await zonesOf(null).catch(() => null);
  if (!zones) return;
  if (newest) newest = { ...newest, zones };
  const { moment } = store.state;
  if (moment) store.set({ moment: { ...moment, zones: kept(zones) } });
}

// ---------------------------------------------------------------- the address

function currentLink(): string {
  const { time, selection, camera } = store.state;
  return formatLink({ t: time.following ? null : time.stamp_ns, selection, view: camera });
}

/** The part of the address behind the # as the page wrote or followed it. */
let addressed = "";

function keepAddress(): void {
  let timer: number | undefined;
  store.subscribe(() => {
    if (timer !== undefined || leaving) return;
    timer = window.setTimeout(() => {
      timer = undefined;
      // Another address is somebody's own: it is followed as soon as the browser says so, and not written over.
      if (leaving || location.hash !== addressed) return;
      const link = currentLink();
      if (link !== location.hash) history.replaceState(null, "", link || location.pathname + location.search);
      addressed = location.hash;
    }, 300);
  });
}

function followAddress(): void {
  addressed = location.hash;
  const link = parseLink(addressed);
  store.set({ selection: link.selection, ...(link.view ? { camera: link.view } : {}) });
  if (link.t) void showPast(link.t);
  else if (!store.state.time.following) goLive();
}
