import { useStore } from "../state/store";
import { store } from "../state/store";
import { isOpen } from "../state/alerts";
import { goLive } from "../state/session";
import { standingOf } from "../state/standing";
import { LATE_S, silence_s } from "../state/time";
import { dateOf, duration, timeOfDay } from "../text/stamp";
import { area } from "../text/units";
import { Icon } from "./icons";
import { useNow } from "./now";

export function TopBar() {
  const scene = useStore((state) => state.scene);
  const panel = useStore((state) => state.panel);
  const alerts = useStore((state) => state.alerts);
  const open = alerts.filter(isOpen);
  const worst = open.some(({ level }) => level === "alarm") ? "alarm" : "warning";
  const toggle = (name: typeof panel) => store.set({ panel: panel === name ? null : name });
  return (
    <header class="top-bar">
      <div class="brand">
        <img src="./mark.svg" width="26" height="26" alt="" />
        <span class="brand-name">crowdfence</span>
        {scene && <span class="mission" title="Mission">{scene.name}</span>}
      </div>
      <Status />
      <Figures />
      <nav class="top-actions">
        <button class={`with-count ${panel === "alerts" ? "on" : ""} ${open.length ? `level-${worst}` : ""}`} onClick={() => toggle("alerts")} title="Alerts (A)" data-test="alerts-button">
          <Icon name="bell" />
          <span class="wide">Alerts</span>
          <b class="count">{open.length}</b>
        </button>
        <button class={panel === "export" ? "on" : ""} onClick={() => toggle("export")} title="Export (E)" data-test="export-button">
          <Icon name="download" />
          <span class="wide">Export</span>
        </button>
        <button class={`square ${panel === "settings" ? "on" : ""}`} onClick={() => toggle("settings")} title="Units, clock and colours" aria-label="Settings" data-test="settings-button">
          <Icon name="gear" />
        </button>
        <button class={`square ${panel === "help" ? "on" : ""}`} onClick={() => toggle("help")} title="Keys and colours (?)" aria-label="Help">
          <Icon name="help" />
        </button>
      </nav>
    </header>
  );
}

function Status() {
  const now = useNow();
  const moment = useStore((state) => state.moment);
  const time = useStore((state) => state.time);
  const connected = useStore((state) => state.connected);
  const mode = useStore((state) => state.mode);
  const clock = useStore((state) => state.clock);
  const late_s = silence_s(store.state);
  const [word, look] = !connected
    ? ["OFFLINE", "bad"]
    : !time.following
      ? [time.playing ? "REPLAY" : "PAUSED", "past"]
      : late_s > LATE_S
        ? ["NO DATA", "bad"]
        : mode === "finished"
          ? ["FINISHED", "done"]
          : mode === "replay"
            ? ["REPLAYING", "live"]
            : ["LIVE", "live"];
  const other = clock === "utc" ? "local" : "utc";
  return (
    <div class="status">
      <button class={`badge ${look}`} onClick={goLive} title="Follow the newest moment (L)" data-test="mode">
        <i />
        {word}
      </button>
      {moment && (
        <div class="clock" title={`${dateOf(now, clock)} ${timeOfDay(now, clock)} ${clock === "utc" ? "UTC" : "local time"}`}>
          <b>{timeOfDay(now, clock, 0)}</b>
          <span>{clock === "utc" ? "UTC" : "local"}</span>
          <span class="second-clock">{timeOfDay(now, other, 0)} {other === "utc" ? "UTC" : "local"}</span>
        </div>
      )}
      {moment && time.following && mode !== "finished" && (
        <span class="lag" title="From the exposure of the newest picture to its zones on this page">
          {late_s > LATE_S ? `silent for ${duration(late_s)}` : moment.lag_s !== null ? `lag ${duration(moment.lag_s)}` : ""}
        </span>
      )}
    </div>
  );
}

function Figures() {
  const moment = useStore((state) => state.moment);
  const units = useStore((state) => state.units);
  if (!moment) return <div class="figures" />;
  const zones = moment.zones.zones;
  const flying = moment.drones.filter((drone) => standingOf(drone) === "ok").length;
  return (
    <dl class="figures">
      <div class={flying < moment.drones.length ? "warn" : ""}>
        <dt>drones</dt>
        <dd data-test="drones">{flying}/{moment.drones.length}</dd>
      </div>
      <div>
        <dt>zones</dt>
        <dd data-test="zones">{zones.length}</dd>
      </div>
      <div>
        <dt>closed</dt>
        <dd data-test="closed">{moment.closed_m2 === null ? "–" : area(moment.closed_m2, units)}</dd>
      </div>
    </dl>
  );
}
