// What the service answers, as it names things. World coordinates are local east-north-up metres.

export type Role = "viewer" | "drone" | "operator";
export type Mode = "live" | "replay" | "finished";
export type Place = [east: number, north: number, up: number];
export type Corner = [east: number, north: number];
/** Parts of rings of corners, as a GeoJSON MultiPolygon has them: the first ring is the outside. */
export type Outline = Corner[][][];

export interface Anchor {
  latitude_deg: number;
  longitude_deg: number;
  height_m: number;
}

export interface TerrainFrame {
  west: number;
  north: number;
  cell_size_m: number;
  rows: number;
  columns: number;
}

export interface Scene {
  name: string;
  /** Of the process that answers: what stays the same may be kept as long as this does. */
  run: string;
  mode: Mode;
  method: string;
  threshold: number;
  parameters: Record<string, unknown>;
  voxel_size_m: number;
  drones: string[];
  /** Without a view for longer a drone is silent. */
  silent_after_s: number;
  anchor: Anchor | null;
  bounds: [west: number, south: number, east: number, north: number];
  terrain: TerrainFrame;
  /** What the operator's own map of the surroundings is, where there is one. */
  base_map: "tiles" | "picture" | null;
  role: Role;
  user: string;
  version: string;
  first_stamp_ns: string | null;
  first_stamp_ms: number | null;
  last_stamp_ns: string | null;
  last_stamp_ms: number | null;
  zone_rules: Record<string, unknown>;
}

export interface Look {
  drone: string;
  last_look_ns: string;
  last_look_ms: number;
  value: number;
  seen_share: number;
  range_m: number;
  looks: number;
}

export interface Zone {
  id: string;
  /** What the file of somebody else calls it, where the id does not say so. */
  name: string | null;
  kind: "crowd" | "unseen" | "static" | "operator";
  restriction: string;
  reason: string | null;
  /** A sentence: why it is closed. */
  why: string | null;
  polygon: Outline;
  /** The columns of crowd alone, where more is closed. */
  crowd_outline: Outline | null;
  closed_m2: number;
  crowd_m2: number | null;
  probability_max: number | null;
  probability_mean: number | null;
  interval: [number, number] | null;
  last_seen_ms: number | null;
  oldest_look_ms: number | null;
  created_ms: number | null;
  valid_until_ms: number | null;
  seen_by: string[];
  band: { lower_m: number; upper_m: number; datum: string };
  evidence: Look[];
  locked: boolean;
  operator: { name: string; reason: string } | null;
  /** Somebody said that this crowd is none; it stays on the list and closes again at that stamp. */
  dismissed?: { until_ms: number } | null;
}

export interface Zones {
  /** That of the scene. */
  run?: string;
  stamp_ns: string;
  stamp_ms: number;
  threshold: number;
  /** Crowd in regions too small for a zone. */
  dropped_m2?: number;
  /** Of the zones of others; null where there are none. */
  static_version: string | null;
  /** Who asks has them. */
  static_left_out: boolean;
  zones: Zone[];
}

export interface ZoneHistory {
  points: { stamp_ms: number; probability_max: number | null; closed_m2: number }[];
  events: { stamp_ms: number; kind: string; id: string; other: string | null }[];
}

export interface Drone {
  drone: string;
  stamp_ns: string | null;
  stamp_ms: number | null;
  age_s: number | null;
  position: Place | null;
  world_from_camera: number[][] | null;
  /** Closed ring on the terrain; empty where the picture shows no ground. */
  footprint: Place[];
  trail?: Place[];
  range_m: number | null;
  /** Unknown: of that moment of the past nobody knows any more. */
  status: "ok" | "stale" | "never" | "unknown";
  picture: boolean;
  heatmap: boolean;
  /** From its stamp to its arrival, of the quickest view of late; of now; null where no clock tells. */
  lag_s: number | null;
  /** Who said that its looks do not count, because it sees nothing; of now, also where the past is shown. */
  left_out: { name: string; reason: string; since_ms: number } | null;
}

export interface TimelinePoint {
  stamp_ns: string;
  stamp_ms: number;
  seen_m2: number;
  crowd_m2: number;
  closed_m2: number;
  zones: number;
}

export interface Timeline {
  points: readonly TimelinePoint[];
  alerts: { stamp_ms: number; id: string; level: AlertLevel }[];
}

export type AlertLevel = "info" | "warning" | "alarm";

export interface Alert {
  id: string;
  kind: string;
  level: AlertLevel;
  text: string;
  drone: string | null;
  zone: string | null;
  raised_ns: string;
  raised_ms: number;
  cleared_ms: number | null;
  acknowledged_by: string | null;
  acknowledged_ms: number | null;
}

export interface AuditEntry {
  /** null where the row is damaged. */
  stamp_ms: number | null;
  user: string;
  role: string;
  action: string;
  zone: string | null;
  drone: string | null;
  reason: string | null;
}

export interface Step {
  type: "step";
  stamp_ns: string;
  stamp_ms: number;
  belief_version: string | number;
  seen_m2: number;
  crowd_m2: number;
  closed_m2: number;
  zones: Zones;
  drones: { drones: Drone[] };
  lag_s: number | null;
  /** How long no view has been accepted; null in a replay, and before the first one. */
  silent_s: number | null;
}

export type Message =
  | { type: "hello"; scene: Scene }
  | Step
  | { type: "alert"; alert: Alert }
  | { type: "mode"; mode: Mode }
  | { type: "ping" };
