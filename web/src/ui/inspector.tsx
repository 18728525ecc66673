// What is known of the thing that is selected; without one, of the mission.

import { useEffect, useState } from "preact/hooks";
import * as api from "../api/client";
import type { Drone, Zone, ZoneHistory } from "../api/contract";
import { areaByState, VoxelState } from "../map/belief";
import { css, droneColour, PALETTES } from "../map/colours";
import { boundsOf, contains, cornersOf, lineLength } from "../map/geometry";
import { select } from "../state/session";
import { standingOf } from "../state/standing";
import { store, useStore } from "../state/store";
import { closureOf } from "../text/closure";
import { ago, dateOf, dayAndTime, duration } from "../text/stamp";
import { area, grouped, height, heights, length, place, probability } from "../text/units";
import { EVENT_WORDS, KIND_WORDS, openWords, STANDING_WORDS, STATE_MEANING, STATE_WORDS } from "../text/words";
import { CameraPicture } from "./camera_strip";
import { Icon } from "./icons";
import { groundAt, map, reading } from "./map_panel";
import { useNow } from "./now";
import { askAbout, askAboutDrone, mayOperate } from "./operator";
import { Sparkline } from "./sparkline";
import { StateSwatch } from "./swatch";

export function Inspector() {
  const selection = useStore((state) => state.selection);
  const moment = useStore((state) => state.moment);
  return (
    <aside key={JSON.stringify(selection)} class="side right" aria-label="Inspector" data-test="inspector">
      {!selection && <Mission />}
      {selection?.kind === "zone" && <ZoneCard key={selection.id} id={selection.id} zone={moment?.zones.zones.find(({ id }) => id === selection.id) ?? null} />}
      {selection?.kind === "drone" && <DroneCard drone={moment?.drones.find(({ drone }) => drone === selection.id) ?? null} id={selection.id} />}
      {selection?.kind === "ground" && <GroundCard east={selection.east} north={selection.north} />}
    </aside>
  );
}

function Head({ title, kind, children }: { title: string; kind: string; children?: preact.ComponentChildren }) {
  return (
    <header class="card-head">
      <div>
        <small>{kind}</small>
        <h1>{title}</h1>
      </div>
      <span class="card-tools">
        {children}
        <button class="square quiet" onClick={() => select(null)} title="Close (Esc)" aria-label="Close">
          <Icon name="close" />
        </button>
      </span>
    </header>
  );
}

function Fact({ name, children, test }: { name: string; children: preact.ComponentChildren; test?: string }) {
  return (
    <div>
      <dt>{name}</dt>
      <dd data-test={test}>{children}</dd>
    </div>
  );
}

// ---------------------------------------------------------------- a zone

function ZoneCard({ id, zone }: { id: string; zone: Zone | null }) {
  const now = useNow();
  const units = useStore((state) => state.units);
  const scene = useStore((state) => state.scene);
  const moment = useStore((state) => state.moment);
  const history = useHistory(id);
  if (!zone) return <Gone id={id} history={history} />;
  const closure = closureOf(zone, now);
  const crowd = zone.kind === "crowd";
  const show = () => {
    const bounds = boundsOf(cornersOf(zone.polygon));
    if (bounds) map()?.flyTo(bounds);
  };
  return (
    <div class={`card kind-${zone.kind}`} data-test="zone-card">
      <Head title={zone.id} kind={KIND_WORDS[zone.kind]}>
        <button class="square quiet" onClick={show} title="Show on the map" aria-label="Show on the map">
          <Icon name="target" />
        </button>
      </Head>
      <div class="why">
        <b>{zone.kind === "crowd" || zone.locked ? "Why still closed" : "Why closed"}</b>
        <p data-test="why">{sentence(closure.why) || "The service gives no reason."}</p>
        {closure.opens && <p class="opens">{closure.opens}</p>}
        {zone.operator && !closure.why.includes(zone.operator.reason) && (
          <p class="opens">
            {zone.operator.name}: “{zone.operator.reason}”
          </p>
        )}
      </div>
      {zone.dismissed && (
        <div class="why exception">
          <b>Dismissed for now</b>
          <p>
            Left out of exports until {dayAndTime(zone.dismissed.until_ms, store.state.clock, now, 0)}; then it is closed again.
          </p>
        </div>
      )}
      <div class="headline">
        {zone.probability_max !== null && (
          <div>
            <dt>largest P</dt>
            <dd data-test="probability">{probability(zone.probability_max)}</dd>
            <small>{zone.interval ? `${probability(zone.interval[0])} to ${probability(zone.interval[1])}` : `crowd from ${(moment?.zones.threshold ?? 0).toFixed(3)}`}</small>
          </div>
        )}
        <div>
          <dt>closed</dt>
          <dd data-test="closed-area">{area(zone.closed_m2, units)}</dd>
          <small>{crowd && zone.crowd_m2 !== null ? `crowd on ${area(zone.crowd_m2, units)}` : zone.restriction.replaceAll("_", " ")}</small>
        </div>
        <div class={closure.counts ? "" : "long"}>
          <dt>ends</dt>
          <dd>{closure.end}</dd>
          <small>{closure.counts ? "if nobody looks again" : "time alone opens nothing"}</small>
        </div>
      </div>
      <HistoryChart history={history} threshold={moment?.zones.threshold ?? 0} />
      {zone.evidence.length > 0 && <Evidence zone={zone} now={now} />}
      <dl class="facts">
        {zone.name !== null && <Fact name="name">{zone.name}</Fact>}
        {crowd && <Fact name="last look">{ago(zone.last_seen_ms, now)}</Fact>}
        {crowd && <Fact name="oldest part">{ago(zone.oldest_look_ms, now)}</Fact>}
        {zone.probability_mean !== null && <Fact name="mean P">{probability(zone.probability_mean)}</Fact>}
        <Fact name="closed since">{zone.created_ms === null ? "not known" : `${dayAndTime(zone.created_ms, store.state.clock, now, 0)}, ${ago(zone.created_ms, now)}`}</Fact>
        {crowd && <Fact name="seen by">{zone.seen_by.join(", ") || "not known"}</Fact>}
        <Fact name="heights">{heights(zone.band, units)}</Fact>
        <Fact name="restriction">{zone.restriction.replaceAll("_", " ")}</Fact>
      </dl>
      <Happened history={history} id={id} />
      <Actions zone={zone} allowed={mayOperate(scene)} />
    </div>
  );
}

function sentence(text: string): string {
  if (!text) return "";
  return `${text[0].toUpperCase()}${text.slice(1)}${/[.!?]$/.test(text) ? "" : "."}`;
}

/** Asked again with every second of the moment shown. */
function useHistory(id: string): ZoneHistory | null {
  const [history, setHistory] = useState<ZoneHistory | null>(null);
  const moment = useStore((state) => state.moment);
  const time = useStore((state) => state.time);
  const second = Math.floor((moment?.stamp_ms ?? 0) / 1000);
  const at = time.following ? null : time.stamp_ns;
  useEffect(() => {
    let ended = false;
    api.zoneHistory(id, at).then(
      (answer) => !ended && setHistory(answer),
      () => {},
    );
    return () => {
      ended = true;
    };
  }, [id, time.following ? second : at]);
  return history;
}

function Gone({ id, history }: { id: string; history: ZoneHistory | null }) {
  return (
    <div class="card" data-test="zone-card">
      <Head title={id} kind="zone" />
      <p class="empty">At this moment there is no zone {id}: it has ended, or has not appeared yet.</p>
      <Happened history={history} id={id} />
    </div>
  );
}

function HistoryChart({ history, threshold }: { history: ZoneHistory | null; threshold: number }) {
  const points = (history?.points ?? []).filter(({ probability_max }) => probability_max !== null);
  if (points.length < 2) return null;
  return (
    <figure class="spark">
      <Sparkline points={points.map(({ stamp_ms, probability_max }) => [stamp_ms, probability_max!])} level={threshold} />
      <figcaption>
        <span>largest P over {duration((points[points.length - 1].stamp_ms - points[0].stamp_ms) / 1000)}</span>
        <span class="level">threshold {threshold.toFixed(3)}</span>
      </figcaption>
    </figure>
  );
}

function Evidence({ zone, now }: { zone: Zone; now: number }) {
  const units = useStore((state) => state.units);
  const scene = useStore((state) => state.scene);
  const theme = useStore((state) => state.theme);
  return (
    <section class="evidence">
      <h2>What the drones showed</h2>
      <table>
        <thead>
          <tr>
            <th>drone</th>
            <th>last look</th>
            <th title="Largest heatmap value on the zone">value</th>
            <th title="Share of the zone that it had in view">in view</th>
            <th>from</th>
            <th>looks</th>
          </tr>
        </thead>
        <tbody>
          {zone.evidence.map((look) => (
            <tr key={look.drone}>
              <th>
                <button class="link" title={look.drone} onClick={() => select({ kind: "drone", id: look.drone })}>
                  <svg width="9" height="9" viewBox="0 0 9 9" aria-hidden="true">
                    <circle cx="4.500" cy="4.500" r="4" fill={css(droneColour(PALETTES[theme], scene?.drones ?? [], look.drone))} />
                  </svg>
                  <span>{look.drone}</span>
                </button>
              </th>
              <td>{ago(look.last_look_ms, now)}</td>
              <td>{look.value.toFixed(2)}</td>
              <td>{Math.round(look.seen_share * 100)} %</td>
              <td>{length(look.range_m, units)}</td>
              <td>{grouped(look.looks)}</td>
            </tr>
          ))}
        </tbody>
      </table>
    </section>
  );
}

function Happened({ history, id }: { history: ZoneHistory | null; id: string }) {
  const now = useNow();
  const clock = useStore((state) => state.clock);
  const events = (history?.events ?? []).filter(({ kind }) => kind !== "updated").slice(-6);
  if (!events.length) return null;
  return (
    <section>
      <h2>What became of it</h2>
      <ol class="events">
        {events.map((event) => (
          <li key={`${event.stamp_ms} ${event.kind} ${event.id}`}>
            <time>{dayAndTime(event.stamp_ms, clock, now)}</time>
            <span>
              {event.id === id ? "" : `${event.id} `}
              {EVENT_WORDS[event.kind] ?? event.kind} {event.other === id ? "it" : (event.other ?? "")}
            </span>
          </li>
        ))}
      </ol>
    </section>
  );
}

function Actions({ zone, allowed }: { zone: Zone; allowed: boolean }) {
  const following = useStore((state) => state.time.following);
  const title = !allowed ? "This needs the role operator" : following ? "" : "Only the newest moment can be changed";
  const disabled = !allowed || !following;
  const ends = zone.kind === "crowd" || zone.locked;
  return (
    <footer class="actions">
      <button disabled={disabled || !ends} title={title || (ends ? "" : "It does not end by itself")} onClick={() => askAbout(zone, zone.locked ? "unlock" : "lock")} data-test="lock">
        <Icon name={zone.locked ? "unlock" : "lock"} />
        {zone.locked ? "Unlock" : "Lock"}
      </button>
      <button disabled={disabled || zone.kind === "static" || zone.kind === "unseen"} title={title} class="danger-quiet" onClick={() => askAbout(zone, "dismiss")} data-test="dismiss">
        <Icon name="close" />
        Dismiss
      </button>
      {!allowed && <small data-test="no-role">Your role sees and changes nothing.</small>}
    </footer>
  );
}

// ---------------------------------------------------------------- a drone

function DroneCard({ drone, id }: { drone: Drone | null; id: string }) {
  const now = useNow();
  const units = useStore((state) => state.units);
  const scene = useStore((state) => state.scene);
  const heights = useStore((state) => state.heights);
  const following = useStore((state) => state.following_drone);
  const moment = useStore((state) => state.moment);
  const live = useStore((state) => state.time.following);
  const [heat, setHeat] = useState(0.75);
  if (!drone) return <div class="card"><Head title={id} kind="drone" /><p class="empty">No drone of this name at this moment.</p></div>;
  const over = drone.position && heights ? drone.position[2] - heights.at(drone.position[0], drone.position[1]) : NaN;
  const zones = (moment?.zones.zones ?? []).filter((zone) => drone.position && contains(zone.polygon, drone.position[0], drone.position[1]));
  return (
    <div class="card" data-test="drone-card">
      <Head title={drone.drone} kind="drone">
        <button class={`square quiet ${following === id ? "on" : ""}`} title="Follow (F)" aria-label="Follow" onClick={() => store.set({ following_drone: following === id ? null : id })}>
          <Icon name="target" />
        </button>
      </Head>
      {drone.left_out && (
        <div class="why exception" data-test="left-out">
          <b>Left out</b>
          <p>Its looks do not count, and what it alone has in view is seen by nobody.</p>
          <p class="opens">
            {drone.left_out.name}, {ago(drone.left_out.since_ms, now)}: “{drone.left_out.reason}”
          </p>
        </div>
      )}
      {zones.length > 0 && (
        <div class="why">
          <b>Over closed ground</b>
          <p>It is above {zones.map((zone) => zone.id).join(", ")}.</p>
        </div>
      )}
      {(drone.picture || drone.heatmap) && (
        <div class="big-picture">
          <CameraPicture drone={drone} heat={heat} />
          <label class="slider">
            <span>Heatmap</span>
            <input type="range" min="0" max="1" step="0.25" value={heat} onInput={(event) => setHeat(Number(event.currentTarget.value))} />
          </label>
        </div>
      )}
      <div class="headline">
        <div>
          <dt>{drone.position && heights && !Number.isFinite(over) ? "no map below" : "above ground"}</dt>
          <dd>{Number.isFinite(over) ? length(over, units) : "–"}</dd>
          <small>{drone.position && scene?.anchor ? `${height(drone.position, scene.anchor, units)} ellipsoid` : " "}</small>
        </div>
        <div>
          <dt>newest view</dt>
          <dd>{ago(drone.stamp_ms, now)}</dd>
          <small>{STANDING_WORDS[standingOf(drone)]}</small>
        </div>
      </div>
      <dl class="facts">
        {drone.position && <Fact name="place">{place(drone.position[0], drone.position[1], scene?.anchor ?? null, units)}</Fact>}
        {drone.position && (
          <Fact name="local">
            E {length(drone.position[0], units, 1)}, N {length(drone.position[1], units, 1)}, U {length(drone.position[2], units, 1)}
          </Fact>
        )}
        {drone.range_m !== null && <Fact name="looks as far as">{length(drone.range_m, units)}</Fact>}
        {(drone.trail?.length ?? 0) > 1 && <Fact name="flown">{length(lineLength(drone.trail!), units)}</Fact>}
        {live && drone.lag_s !== null && <Fact name="views come" test="lag">{lagOf(drone.lag_s)}</Fact>}
        <Fact name="footprint">{drone.footprint.length ? "on the map" : "no ground in the picture"}</Fact>
      </dl>
      <DroneActions drone={drone} allowed={mayOperate(scene)} />
    </div>
  );
}

/** Of the quickest of late: what waits for a slow link, and a clock that is off, show here alike. */
function lagOf(lag_s: number): string {
  return lag_s < 0 ? `${duration(-lag_s)} before their stamps` : `${duration(lag_s)} after their stamps`;
}

function DroneActions({ drone, allowed }: { drone: Drone; allowed: boolean }) {
  const following = useStore((state) => state.time.following);
  const meaning = drone.left_out ? "" : "Where it is blind: what it sees does not count until it is taken in again";
  const title = !allowed ? "This needs the role operator" : following ? meaning : "Only the newest moment can be changed";
  return (
    <footer class="actions">
      <button disabled={!allowed || !following} title={title} onClick={() => askAboutDrone(drone)} data-test="leave-out">
        <Icon name={drone.left_out ? "eye" : "eye-off"} />
        {drone.left_out ? "Take in again" : "Leave out"}
      </button>
    </footer>
  );
}

// ---------------------------------------------------------------- a spot of ground

function GroundCard({ east, north }: { east: number; north: number }) {
  useStore((state) => state.belief);
  useStore((state) => state.older_s);
  const units = useStore((state) => state.units);
  const scene = useStore((state) => state.scene);
  const heights = useStore((state) => state.heights);
  const theme = useStore((state) => state.theme);
  const moment = useStore((state) => state.moment);
  const ground = groundAt(east, north);
  const zones = (moment?.zones.zones ?? []).filter((zone) => contains(zone.polygon, east, north));
  const up = heights?.at(east, north) ?? NaN;
  const state = ground?.state ?? VoxelState.neverSeen;
  return (
    <div class="card" data-test="ground-card">
      <Head title={STATE_WORDS[state]} kind="ground">
        {state !== VoxelState.crowd && <StateSwatch state={state} theme={theme} />}
      </Head>
      <div class="why">
        <p>{STATE_MEANING[state]}</p>
        {zones.length > 0 ? (
          <p class="opens">
            Closed by{" "}
            {zones.map((zone) => (
              <button key={zone.id} class="link" onClick={() => select({ kind: "zone", id: zone.id })}>
                {zone.id}
              </button>
            ))}
            .
          </p>
        ) : (
          openWords(state) !== null && <p class="opens">{openWords(state)}</p>
        )}
      </div>
      <dl class="facts">
        <Fact name="probability">{ground?.probability === null || !ground ? "not known" : probability(ground.probability)}</Fact>
        <Fact name="last look">{ground?.age_s === null || !ground ? "none known" : `${duration(ground.age_s)} ago`}</Fact>
        <Fact name="place">{place(east, north, scene?.anchor ?? null, units)}</Fact>
        <Fact name="local">
          E {length(east, units, 1)}, N {length(north, units, 1)}
        </Fact>
        {Number.isFinite(up) && <Fact name="height">{height([east, north, up], scene?.anchor ?? null, units)}{scene?.anchor ? " ellipsoid" : ""}</Fact>}
      </dl>
    </div>
  );
}

// ---------------------------------------------------------------- the mission

const ORDER = [VoxelState.crowd, VoxelState.empty, VoxelState.notCleared, VoxelState.stale, VoxelState.occluded];

function Mission() {
  const scene = useStore((state) => state.scene);
  const belief = useStore((state) => state.belief);
  useStore((state) => state.older_s);
  const moment = useStore((state) => state.moment);
  const units = useStore((state) => state.units);
  const theme = useStore((state) => state.theme);
  const clock = useStore((state) => state.clock);
  const timeline = useStore((state) => state.timeline);
  if (!scene) return null;
  const areas = belief ? areaByState(belief, reading(store.state)) : null;
  const known = areas ? ORDER.reduce((sum, state) => sum + areas[state], 0) : 0;
  const first = timeline.points[0];
  const last = timeline.points.at(-1);
  const palette = PALETTES[theme];
  return (
    <div class="card" data-test="mission-card">
      <header class="card-head">
        <div>
          <small>mission</small>
          <h1>{scene.name}</h1>
        </div>
      </header>
      <section>
        <h2>Ground that cameras pointed at</h2>
        {areas ? (
          <>
            <svg class="shares" viewBox="0 0 100 6" preserveAspectRatio="none" aria-hidden="true">
              {
                ORDER.reduce<[number, preact.JSX.Element[]]>(
                  ([x, bars], state) => {
                    const width = known ? (100 * areas[state]) / known : 0;
                    return [x + width, [...bars, <rect key={state} x={x} y="0" width={width} height="6" fill={css(palette.states[state])} />]];
                  },
                  [0, []],
                )[1]
              }
            </svg>
            <ul class="areas">
              {ORDER.map((state) => (
                <li key={state} title={STATE_MEANING[state]}>
                  <StateSwatch state={state} theme={theme} />
                  <span>{STATE_WORDS[state]}</span>
                  <b>{area(areas[state], units)}</b>
                </li>
              ))}
            </ul>
            {(moment?.zones.dropped_m2 ?? 0) > 0 && <p class="hint">{area(moment!.zones.dropped_m2!, units)} of the crowd lie in regions that are too small for a zone.</p>}
            <p class="hint">Everything else on the map was never seen. Only “{STATE_WORDS[VoxelState.empty]}” speaks against crowd.</p>
          </>
        ) : (
          <p class="empty">{moment ? "Nothing has been seen yet." : "Not known yet."}</p>
        )}
      </section>
      <dl class="facts">
        <Fact name="method">{scene.method}</Fact>
        <Fact name="crowd from">P ≥ {(moment?.zones.threshold ?? scene.threshold).toFixed(3)}</Fact>
        {first && last && <Fact name="time">{dateOf(first.stamp_ms, clock)}, {duration((last.stamp_ms - first.stamp_ms) / 1000)}</Fact>}
        {Number(scene.zone_rules.buffer_m) > 0 && <Fact name="safety distance">{length(Number(scene.zone_rules.buffer_m), units)}</Fact>}
        <Fact name="voxels">{length(scene.voxel_size_m, units, 1)}</Fact>
        <Fact name="anchor">{scene.anchor ? place(0, 0, scene.anchor, units) : "local metres, no place on Earth"}</Fact>
        <Fact name="you">
          {scene.user}, {scene.role}
        </Fact>
        <Fact name="version">{scene.version}</Fact>
      </dl>
      <p class="hint">Click the map, a zone or a drone to see what is known of it.</p>
      {mayOperate(scene) && (
        <button class="link" onClick={() => store.set({ panel: "audit" })}>
          What operators did
        </button>
      )}
    </div>
  );
}
