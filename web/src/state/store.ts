// One state for the whole page, replaced piece by piece; whoever draws it subscribes.

import { useEffect, useState } from "preact/hooks";
import type { Alert, Corner, Drone, Mode, Scene, Timeline, Zones } from "../api/contract";
import type { Belief } from "../map/belief";
import type { Camera } from "../map/camera";
import type { Theme } from "../map/colours";
import type { Heights } from "../map/heights";
import type { Clock } from "../text/stamp";
import type { Units } from "../text/units";

export interface Layers {
  base: boolean;
  belief: boolean;
  age: boolean;
  zones: boolean;
  walls: boolean;
  tracks: boolean;
  footprints: boolean;
  labels: boolean;
  pictures: boolean;
}

export type Selection =
  | { kind: "zone"; id: string }
  | { kind: "drone"; id: string }
  | { kind: "ground"; east: number; north: number }
  | null;

/** Which moment is shown: the newest (`following`), or one of the past. */
export interface Time {
  following: boolean;
  playing: boolean;
  speed: number;
  /** Of the past moment; null while following. */
  stamp_ns: string | null;
  stamp_ms: number | null;
}

/** Everything of one moment. */
export interface Moment {
  stamp_ns: string;
  stamp_ms: number;
  zones: Zones;
  drones: Drone[];
  lag_s: number | null;
  /** How long no view had been accepted when it arrived. */
  silent_s: number | null;
  /** Of all zones together, where they overlap once. */
  closed_m2: number | null;
  /** `elapsed_ms()` when it arrived. */
  arrived: number;
}

export interface Notice {
  id: number;
  level: "info" | "error";
  text: string;
}

export interface State {
  scene: Scene | null;
  mode: Mode | null;
  connected: boolean;
  /** The service answers, and has nobody with the token of this browser: no new attempt helps. */
  unknown: boolean;
  /** Why the page shows nothing, where it does not. */
  failure: string | null;
  /** Whether the browser draws no map: it has no WebGL, or has lost what it drew with. */
  blank: boolean;
  heights: Heights | null;
  moment: Moment | null;
  belief: Belief | null;
  belief_arrived: number;
  /** Whole seconds by which the belief is older than now, once it is old: what shows it is drawn anew. */
  older_s: number;
  timeline: Timeline;
  alerts: Alert[];
  time: Time;
  selection: Selection;
  following_drone: string | null;
  camera: Camera | null;
  layers: Layers;
  strength: number;
  drawing: Corner[] | null;
  panel: "alerts" | "export" | "settings" | "help" | "audit" | null;
  sides: { left: boolean; right: boolean };
  theme: Theme;
  units: Units;
  clock: Clock;
  notices: Notice[];
  /** Counts what was drawn, so that tests can wait for it. */
  drapes: number;
  /** Of the base map, once it is drawn. */
  attribution: string | null;
}

export const EMPTY_STATE: State = {
  scene: null,
  mode: null,
  connected: false,
  unknown: false,
  failure: null,
  blank: false,
  heights: null,
  moment: null,
  belief: null,
  belief_arrived: 0,
  older_s: 0,
  timeline: { points: [], alerts: [] },
  alerts: [],
  time: { following: true, playing: false, speed: 1, stamp_ns: null, stamp_ms: null },
  selection: null,
  following_drone: null,
  camera: null,
  layers: {
    base: true,
    belief: true,
    age: false,
    zones: true,
    walls: true,
    tracks: true,
    footprints: true,
    labels: true,
    pictures: true,
  },
  strength: 1,
  drawing: null,
  panel: null,
  sides: { left: true, right: true },
  theme: "dark",
  units: "metres",
  clock: "utc",
  notices: [],
  drapes: 0,
  attribution: null,
};

export class Store {
  private listeners = new Set<(state: State) => void>();

  constructor(private current: State = EMPTY_STATE) {}

  get state(): State {
    return this.current;
  }

  set(change: Partial<State>): void {
    this.current = { ...this.current, ...change };
    for (const listener of [...this.listeners]) listener(this.current);
  }

  subscribe(listener: (state: State) => void): () => void {
    this.listeners.add(listener);
    return () => this.listeners.delete(listener);
  }
}

export const store = new Store();

/** Redraws a component when what it picks has changed. */
export function useStore<T>(pick: (state: State) => T): T {
  const [value, setValue] = useState(() => pick(store.state));
  useEffect(() => {
    const update = () => setValue(() => pick(store.state));
    update();
    return store.subscribe(update);
    // `pick` is written in place at every call and always picks the same.
  }, []);
  return value;
}
