// What opens from the top bar.

import { useEffect, useLayoutEffect, useRef, useState } from "preact/hooks";
import * as api from "../api/client";
import type { Alert, AuditEntry } from "../api/contract";
import { byUrgency, isOpen, subjectOf } from "../state/alerts";
import { acknowledge, notify, reasonOf, select, settle, showWhen } from "../state/session";
import { store, useStore } from "../state/store";
import { dateOf, dayAndTime, timeOfDay, withTimes } from "../text/stamp";
import { exportCommand, FORMATS } from "../text/exports";
import { Icon } from "./icons";
import { Legend } from "./left_panel";
import { map } from "./map_panel";
import { useNow } from "./now";
import { mayOperate } from "./operator";

export function Panel() {
  const panel = useStore((state) => state.panel);
  const shown = useRef<HTMLElement>(null);
  // Whoever has no mouse goes on in what has opened, and then from where it was opened.
  useLayoutEffect(() => {
    const before = document.activeElement;
    if (!panel || !(before instanceof HTMLElement)) return;
    shown.current?.focus();
    return () => before.focus();
  }, [panel]);
  if (!panel) return null;
  const close = () => store.set({ panel: null });
  const [title, body] = {
    alerts: ["Alerts", <Alerts key="alerts" />],
    export: ["Export", <Exports key="export" />],
    settings: ["Settings", <Settings key="settings" />],
    help: ["Keys and colours", <Help key="help" />],
    audit: ["What operators did", <Audit key="audit" />],
  }[panel] as [string, preact.JSX.Element];
  return (
    <>
      <div class="behind" onClick={close} />
      <section ref={shown} tabIndex={-1} class={`panel panel-${panel}`} role="dialog" aria-label={title} data-test={`panel-${panel}`}>
        <header>
          <h2>{title}</h2>
          <button class="square quiet" onClick={close} aria-label="Close">
            <Icon name="close" />
          </button>
        </header>
        {body}
      </section>
    </>
  );
}

function Alerts() {
  const now = useNow();
  const alerts = useStore((state) => state.alerts);
  const scene = useStore((state) => state.scene);
  if (!alerts.length) return <p class="empty">Nothing has been out of order so far.</p>;
  const open = alerts.filter(isOpen);
  const many = open.length > 1 && mayOperate(scene);
  return (
    <>
      {many && (
        <button onClick={() => acknowledge(...open.map(({ id }) => id))} data-test="acknowledge-all">
          Acknowledge all {open.length}
        </button>
      )}
      <ul class="alerts">
        {byUrgency(alerts).map((alert) => (
          <AlertRow key={alert.id} alert={alert} now={now} />
        ))}
      </ul>
    </>
  );
}

function AlertRow({ alert, now }: { alert: Alert; now: number }) {
  const clock = useStore((state) => state.clock);
  const scene = useStore((state) => state.scene);
  const operator = mayOperate(scene);
  const subject = subjectOf(alert);
  const open = () => {
    select(subject);
    store.set({ panel: null });
  };
  return (
    <li class={`alert ${alert.level} ${alert.acknowledged_by ? "done" : ""}`} data-alert={alert.id}>
      <i />
      <div>
        <p>{withTimes(alert.text, clock, now)}</p>
        <small>
          <button class="link" onClick={() => showWhen(alert.raised_ns)} title="Show this moment">
            {dayAndTime(alert.raised_ms, clock, now)}
          </button>
          {alert.cleared_ms !== null && ` · over at ${dayAndTime(alert.cleared_ms, clock, now)}`}
          {alert.acknowledged_by && ` · acknowledged by ${alert.acknowledged_by}`}
        </small>
      </div>
      <span class="alert-actions">
        {subject && (
          <button class="quiet" onClick={open}>
            Show
          </button>
        )}
        {!alert.acknowledged_by && (
          <button disabled={!operator} title={operator ? "" : "This needs the role operator"} onClick={() => acknowledge(alert.id)} data-test="acknowledge">
            Acknowledge
          </button>
        )}
      </span>
    </li>
  );
}

function Exports() {
  const time = useStore((state) => state.time);
  const scene = useStore((state) => state.scene);
  const clock = useStore((state) => state.clock);
  const moment = useStore((state) => state.moment);
  const [country, setCountry] = useState("");
  const at = time.following ? null : time.stamp_ns;
  const formats = FORMATS.filter(({ earth }) => scene?.anchor || !earth);
  const picture = async () => {
    const blob = await map()?.picture();
    if (!blob) return notify("The browser gives no picture of the map.", "error");
    const link = document.createElement("a");
    link.href = URL.createObjectURL(blob);
    link.download = `${scene?.name ?? "crowdfence"}.png`;
    link.click();
    URL.revokeObjectURL(link.href);
  };
  return (
    <>
      <p class="hint">
        The zones of <b>{at ? dayAndTime(moment?.stamp_ms ?? 0, clock, Date.now()) : "now"}</b>
        {at ? ", the moment shown" : ""}. They hold from the instant that found them.
      </p>
      <ul class="exports">
        {formats.map((format) => {
          const more: Record<string, string> = format.country && country ? { country } : {};
          const missing = format.country && country.length !== 3;
          const command = exportCommand(format.name, { at, country: format.country ? country || "ABC" : null });
          return (
            <li key={format.name}>
              <div>
                <b>{format.title}</b>
                <small>{format.use}</small>
              </div>
              <button class="quiet square" title={`Copy: ${command}`} aria-label={`Copy the command for ${format.title}`} onClick={() => copy(command)}>
                <Icon name="copy" />
              </button>
              {missing ? (
                <button class="button" disabled title="Give the country below first">
                  <Icon name="download" />
                </button>
              ) : (
                <a class="button" href={api.exportAddress(format.name, at, more)} download title={`Download ${format.title}`} aria-label={`Download ${format.title}`} data-export={format.name}>
                  <Icon name="download" />
                </a>
              )}
            </li>
          );
        })}
        <li>
          <div>
            <b>Picture</b>
            <small>the map as it is on the screen, PNG</small>
          </div>
          <button class="button" onClick={picture} title="Download the picture" aria-label="Download the picture">
            <Icon name="download" />
          </button>
        </li>
      </ul>
      <footer class="panel-foot">
        <label>
          Country for ED-318 and ED-269
          <input value={country} maxLength={3} placeholder="ABC" size={4} onInput={(event) => setCountry(event.currentTarget.value.toUpperCase())} />
        </label>
        <button onClick={() => copy(location.href)}>
          <Icon name="link" /> Copy link to this view
        </button>
      </footer>
    </>
  );
}

/** The clipboard of a page that is not served safely is closed; then the text is shown. */
async function copy(text: string): Promise<void> {
  try {
    await navigator.clipboard.writeText(text);
    notify(`Copied: ${text}`);
  } catch {
    notify(text);
  }
}

function Settings() {
  const theme = useStore((state) => state.theme);
  const units = useStore((state) => state.units);
  const clock = useStore((state) => state.clock);
  return (
    <div class="choices">
      <Choice name="Colours" value={theme} of={{ dark: "dark", light: "light" }} onChoose={(value) => settle({ theme: value })} />
      <Choice name="Lengths" value={units} of={{ metres: "metres", feet: "feet" }} onChoose={(value) => settle({ units: value })} />
      <Choice name="Clock" value={clock} of={{ utc: "UTC", local: "local" }} onChoose={(value) => settle({ clock: value })} />
    </div>
  );
}

function Choice<T extends string>({ name, value, of, onChoose }: { name: string; value: T; of: Record<T, string>; onChoose: (value: T) => void }) {
  return (
    <div class="choice" role="radiogroup" aria-label={name}>
      <span>{name}</span>
      <div class="segments">
        {(Object.keys(of) as T[]).map((one) => (
          <button key={one} role="radio" aria-checked={one === value} class={one === value ? "on" : ""} onClick={() => onChoose(one)} data-choice={one}>
            {of[one]}
          </button>
        ))}
      </div>
    </div>
  );
}

const KEYS: [string, string][] = [
  ["Space", "play or pause"],
  ["← →", "one instant back or on"],
  ["L", "follow the newest"],
  ["J K", "next or previous zone"],
  ["F", "follow the selected drone"],
  ["+ −", "closer, farther"],
  ["N T Home", "north up, from above, everything"],
  ["D", "close ground (operator)"],
  ["A E", "alerts, export"],
  ["[ ]", "left and right panel"],
  ["Esc", "close, let go"],
];

function Help() {
  return (
    <div class="help">
      <dl class="keys">
        {KEYS.map(([key, words]) => (
          <div key={key}>
            <dt>
              {key.split(" ").map((one) => (
                <kbd key={one}>{one}</kbd>
              ))}
            </dt>
            <dd>{words}</dd>
          </div>
        ))}
        <div>
          <dt>
            <kbd>drag</kbd>
          </dt>
          <dd>move; with the right button or Ctrl: turn and tilt; wheel: closer</dd>
        </div>
      </dl>
      <Legend />
      <p class="hint">Older looks are paler. Crowd never fades. Ground that was not cleared never looks empty.</p>
    </div>
  );
}

function Audit() {
  const clock = useStore((state) => state.clock);
  const [entries, setEntries] = useState<AuditEntry[] | null>(null);
  const [refusal, setRefusal] = useState("");
  useEffect(() => {
    api.audit().then(setEntries, (error) => setRefusal(reasonOf(error)));
  }, []);
  if (refusal) return <p class="refusal">{refusal}</p>;
  if (!entries) return <p class="empty">Loading…</p>;
  if (!entries.length) return <p class="empty">Nobody has changed anything.</p>;
  return (
    <table class="audit">
      <thead>
        <tr>
          <th>when</th>
          <th>who</th>
          <th>did</th>
          <th>zone or drone</th>
          <th>why</th>
        </tr>
      </thead>
      <tbody>
        {entries.map((entry, k) => (
          <tr key={k}>
            <td>
              {entry.stamp_ms === null ? "time lost" : `${dateOf(entry.stamp_ms, clock)} ${timeOfDay(entry.stamp_ms, clock, 0)}`}
            </td>
            <td>
              {entry.user} <small>{entry.role}</small>
            </td>
            <td>{entry.action.replaceAll("_", " ")}</td>
            <td>{entry.zone ?? entry.drone ?? ""}</td>
            <td>{entry.reason ?? ""}</td>
          </tr>
        ))}
      </tbody>
    </table>
  );
}
