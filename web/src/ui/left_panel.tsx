import type { Zone } from "../api/contract";
import { VoxelState } from "../map/belief";
import { css, droneColour, PALETTES } from "../map/colours";
import { boundsOf, cornersOf } from "../map/geometry";
import { select } from "../state/session";
import { standingOf } from "../state/standing";
import { store, useStore, type Layers } from "../state/store";
import { closureOf } from "../text/closure";
import { ago, duration } from "../text/stamp";
import { area, length, probability } from "../text/units";
import { STATE_MEANING, STATE_WORDS } from "../text/words";
import { Icon } from "./icons";
import { map } from "./map_panel";
import { useNow, useTold } from "./now";
import { RampSwatch, StateSwatch } from "./swatch";

export function LeftPanel() {
  return (
    <aside class="side left" aria-label="Zones, fleet and layers">
      <ZoneList />
      <Fleet />
      <LayerList />
    </aside>
  );
}

function ZoneList() {
  const moment = useStore((state) => state.moment);
  const zones = moment?.zones.zones ?? [];
  return (
    <section class="grow">
      <h2>
        Closed ground <b>{moment ? zones.length : "–"}</b>
      </h2>
      {moment && zones.length === 0 && (
        <p class="empty">No zone is closed. That says nothing of ground that nobody has seen.</p>
      )}
      <ul class="list" data-test="zone-list">
        {zones.map((zone) => (
          <ZoneRow key={zone.id} zone={zone} />
        ))}
      </ul>
    </section>
  );
}

function ZoneRow({ zone }: { zone: Zone }) {
  const closure = useTold((now) => closureOf(zone, now));
  const units = useStore((state) => state.units);
  const chosen = useStore(({ selection }) => selection?.kind === "zone" && selection.id === zone.id);
  const open = () => {
    select({ kind: "zone", id: zone.id });
    const bounds = boundsOf(cornersOf(zone.polygon));
    if (bounds) map()?.flyTo(bounds);
  };
  return (
    <li>
      <button class={`row zone-row kind-${zone.kind} ${chosen ? "chosen" : ""}`} onClick={open} data-zone={zone.id}>
        <span class="zone-name">
          {zone.id}
          {zone.locked && <Icon name="lock" size={12} />}
        </span>
        <span class="row-main">
          <span title={zone.name ?? undefined}>{zone.name ?? closure.reason}</span>
          <small>{closure.counts ? `ends in ${closure.end}` : closure.end}</small>
        </span>
        <span class="row-figures">
          <b>{area(zone.closed_m2, units)}</b>
          <small>{zone.probability_max === null ? "" : `P ${probability(zone.probability_max)}`}</small>
        </span>
      </button>
    </li>
  );
}

function Fleet() {
  const now = useNow();
  const moment = useStore((state) => state.moment);
  const scene = useStore((state) => state.scene);
  const selection = useStore((state) => state.selection);
  const theme = useStore((state) => state.theme);
  const units = useStore((state) => state.units);
  const heights = useStore((state) => state.heights);
  const following = useStore((state) => state.following_drone);
  const drones = [...(moment?.drones ?? [])].sort((a, b) => a.drone.localeCompare(b.drone, "en", { numeric: true }));
  const palette = PALETTES[theme];
  return (
    <section>
      <h2>
        Fleet <b>{moment ? drones.length : "–"}</b>
      </h2>
      {moment && drones.length === 0 && <p class="empty">No drone has sent a view yet.</p>}
      <ul class="list">
        {drones.map((drone) => {
          const chosen = selection?.kind === "drone" && selection.id === drone.drone;
          const over = drone.position && heights ? drone.position[2] - heights.at(drone.position[0], drone.position[1]) : NaN;
          return (
            <li key={drone.drone} class="drone-row">
              <button class={`row ${chosen ? "chosen" : ""} ${standingOf(drone)}`} onClick={() => select({ kind: "drone", id: drone.drone })}>
                <svg width="12" height="12" viewBox="0 0 12 12" aria-hidden="true">
                  <circle cx="6" cy="6" r="4.500" fill={css(droneColour(palette, scene?.drones ?? [], drone.drone))} />
                </svg>
                <span class="row-main">
                  <span>{drone.drone}</span>
                  <small title={drone.left_out?.reason}>{drone.left_out ? "left out" : drone.status === "unknown" ? "not known any more" : drone.stamp_ms === null ? "no view yet" : drone.status === "stale" ? `silent ${duration((now - drone.stamp_ms) / 1000)}` : ago(drone.stamp_ms, now)}</small>
                </span>
                <span class="row-figures">
                  <b>{Number.isFinite(over) ? length(over, units) : "–"}</b>
                  <small>{drone.position && heights && !Number.isFinite(over) ? "no map below" : "above ground"}</small>
                </span>
              </button>
              <button
                class={`square quiet ${following === drone.drone ? "on" : ""}`}
                title={`Follow ${drone.drone} (F)`}
                aria-label={`Follow ${drone.drone}`}
                onClick={() => store.set({ following_drone: following === drone.drone ? null : drone.drone })}
              >
                <Icon name="target" />
              </button>
            </li>
          );
        })}
      </ul>
    </section>
  );
}

const LAYER_WORDS: [keyof Layers, string][] = [
  ["belief", "Ground"],
  ["age", "… by age"],
  ["zones", "Zones"],
  ["walls", "Walls"],
  ["tracks", "Drones"],
  ["footprints", "Footprints"],
  ["labels", "Labels"],
  ["pictures", "Pictures"],
  ["base", "Base map"],
];

const LAYER_MEANING: Record<keyof Layers, string> = {
  base: "The map of the surroundings that the service was started with",
  belief: "What is known of the ground",
  age: "The ground coloured by how long ago it was looked at",
  zones: "Closed ground and the safety distance around crowd",
  walls: "Walls around closed ground",
  tracks: "Drones, their trails and where they look",
  footprints: "The ground in each newest picture",
  labels: "Names on the map",
  pictures: "Newest picture of each drone with its heatmap",
};

const LEGEND = [VoxelState.crowd, VoxelState.empty, VoxelState.notCleared, VoxelState.stale, VoxelState.occluded, VoxelState.neverSeen];

function LayerList() {
  const layers = useStore((state) => state.layers);
  const strength = useStore((state) => state.strength);
  const surrounded = useStore((state) => Boolean(state.scene?.base_map));
  return (
    <section>
      <h2>Layers</h2>
      <div class="layers">
        {LAYER_WORDS.filter(([name]) => name !== "base" || surrounded).map(([name, words]) => (
          <label key={name} title={LAYER_MEANING[name]}>
            <input type="checkbox" checked={layers[name]} disabled={name === "age" && !layers.belief} onChange={() => store.set({ layers: { ...layers, [name]: !layers[name] } })} data-layer={name} />
            {words}
          </label>
        ))}
        <label class="slider" title="How strongly seen ground is coloured; crowd does not fade">
          <span>Strength</span>
          <input type="range" min="0.2" max="1" step="0.05" value={strength} onInput={(event) => store.set({ strength: Number(event.currentTarget.value) })} />
        </label>
      </div>
      <Legend />
    </section>
  );
}

export function Legend() {
  const theme = useStore((state) => state.theme);
  const scene = useStore((state) => state.scene);
  return (
    <div class="legend" data-test="legend">
      <div class="ramp">
        <RampSwatch />
        <span>
          <small>P {scene ? scene.threshold.toFixed(3) : ""}</small>
          <small>crowd</small>
          <small>1</small>
        </span>
      </div>
      {LEGEND.slice(1).map((state) => (
        <div key={state} title={STATE_MEANING[state]}>
          <StateSwatch state={state} theme={theme} />
          {STATE_WORDS[state]}
        </div>
      ))}
    </div>
  );
}
