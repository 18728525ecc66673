// One line for live, pause and replay, with the crowd and the closed ground over time.

import { useRef } from "preact/hooks";
import type { TimelinePoint } from "../api/contract";
import { marks } from "../state/alerts";
import { goLive, playOrPause, seek, setSpeed, stepBy } from "../state/session";
import { store, useStore, type Moment } from "../state/store";
import { pointAt } from "../state/time";
import { dayAndTime, duration, timeOfDay } from "../text/stamp";
import { area } from "../text/units";
import { Icon } from "./icons";

const WIDTH = 1000;
const HEIGHT = 52;
/** Of the line's length: the width of a mark on a tablet. */
const MARKS_APART = 0.012;
const SPEEDS = [0.25, 0.5, 1, 2, 4, 10];

export function TimelinePanel() {
  const timeline = useStore((state) => state.timeline);
  const time = useStore((state) => state.time);
  const moment = useStore((state) => state.moment);
  const clock = useStore((state) => state.clock);
  const mode = useStore((state) => state.mode);
  const { points } = timeline;
  const first = points[0]?.stamp_ms ?? 0;
  const last = points.at(-1)?.stamp_ms ?? first;
  return (
    <footer class="timeline" data-test="timeline">
      <div class="transport">
        <button class="square" title="One step back (←)" aria-label="One step back" onClick={() => stepBy(-1)} disabled={points.length < 2}>
          <Icon name="back" />
        </button>
        <button class="square play" title="Play or pause (Space)" aria-label="Play or pause" onClick={playOrPause} disabled={points.length < 2} data-test="play">
          <Icon name={time.playing || (time.following && mode !== "finished") ? "pause" : "play"} size={18} />
        </button>
        <button class="square" title="One step on (→)" aria-label="One step on" onClick={() => stepBy(1)} disabled={points.length < 2 || time.following}>
          <Icon name="forward" />
        </button>
        <select value={time.speed} title="Speed of replay" aria-label="Speed of replay" onChange={(event) => setSpeed(Number(event.currentTarget.value))}>
          {SPEEDS.map((speed) => (
            <option key={speed} value={speed}>
              {speed}×
            </option>
          ))}
        </select>
        <button class={`live ${time.following ? "on" : ""}`} onClick={goLive} title="Follow the newest moment (L)" data-test="follow">
          Newest
        </button>
      </div>
      <div class="track-column">
        {points.length > 1 ? <Track points={points} /> : <p class="empty">The time line begins with the second instant.</p>}
        <div class="axis">
          <time>{points.length ? dayAndTime(first, clock, last) : ""}</time>
          <Key moment={moment} points={points} />
          <time>{points.length ? timeOfDay(last, clock) : ""}</time>
        </div>
      </div>
    </footer>
  );
}

function Key({ moment, points }: { moment: Moment | null; points: readonly TimelinePoint[] }) {
  const units = useStore((state) => state.units);
  if (moment === null || !points.length) return <span />;
  const point = pointAt(points, moment.stamp_ns);
  const figure = (of: (point: TimelinePoint) => number) => (point ? area(of(point), units) : "–");
  return (
    <span class="key">
      <i class="closed" /> closed {figure((one) => one.closed_m2)}
      <i class="crowd" /> crowd {figure((one) => one.crowd_m2)}
      <i class="seen" /> seen {figure((one) => one.seen_m2)}
      <span class="offset">+{duration((moment.stamp_ms - points[0].stamp_ms) / 1000)}</span>
    </span>
  );
}

function Track({ points }: { points: readonly TimelinePoint[] }) {
  const track = useRef<HTMLDivElement>(null);
  const alerts = useStore((state) => state.timeline.alerts);
  const moment = useStore((state) => state.moment);
  const all = useStore((state) => state.alerts);
  const clock = useStore((state) => state.clock);
  const first = points[0].stamp_ms;
  const span = Math.max(points[points.length - 1].stamp_ms - first, 1);
  const top = Math.max(...points.map((point) => Math.max(point.closed_m2, point.crowd_m2)), 1);
  const most = Math.max(...points.map((point) => point.seen_m2), 1);
  const x = (stamp_ms: number) => ((stamp_ms - first) / span) * WIDTH;
  const path = (of: (point: TimelinePoint) => number, scale: number) =>
    points.map((point, k) => `${k ? "L" : "M"}${x(point.stamp_ms).toFixed(1)} ${(HEIGHT - 2 - (of(point) / scale) * (HEIGHT - 8)).toFixed(1)}`).join("");
  const filled = (line: string) => `${line}L${WIDTH} ${HEIGHT}L0 ${HEIGHT}Z`;
  const closed = path((point) => point.closed_m2, top);
  const crowd = path((point) => point.crowd_m2, top);
  const at = (event: PointerEvent) => {
    const box = track.current!.getBoundingClientRect();
    seek(first + Math.min(Math.max((event.clientX - box.left) / box.width, 0), 1) * span);
  };
  const down = (event: PointerEvent) => {
    track.current!.setPointerCapture(event.pointerId);
    store.set({ time: { ...store.state.time, playing: false } });
    at(event);
  };
  const head = moment ? Math.min(Math.max(x(moment.stamp_ms) / WIDTH, 0), 1) : 1;
  return (
    <div
      ref={track}
      class="track"
      role="slider"
      tabIndex={0}
      aria-label="Moment shown"
      aria-valuemin={0}
      aria-valuemax={Math.round(span / 1000)}
      aria-valuenow={Math.round(((moment?.stamp_ms ?? first) - first) / 1000)}
      aria-valuetext={moment ? timeOfDay(moment.stamp_ms, clock) : ""}
      onPointerDown={down}
      onPointerMove={(event) => event.buttons === 1 && at(event)}
      data-test="track"
    >
      <svg viewBox={`0 0 ${WIDTH} ${HEIGHT}`} preserveAspectRatio="none" aria-hidden="true">
        <path class="area-closed" d={filled(closed)} />
        <path class="area-crowd" d={filled(crowd)} />
        <path class="line-seen" d={path((point) => point.seen_m2, most)} />
        <path class="line-closed" d={closed} />
        <path class="line-crowd" d={crowd} />
      </svg>
      {marks(alerts.filter(({ stamp_ms }) => stamp_ms >= first && stamp_ms <= first + span), ({ stamp_ms }) => x(stamp_ms) / WIDTH, MARKS_APART)
        .map(({ id, stamp_ms, level }) => (
          <i key={id} class={`tick ${level}`} title={all.find((one) => one.id === id)?.text ?? level} style={{ left: `${(x(stamp_ms) / WIDTH) * 100}%` }} />
        ))}
      <i class="head" style={{ left: `${head * 100}%` }} />
    </div>
  );
}
