// What an operator must not overlook, over the map.

import type { Alert } from "../api/contract";
import { subjectOf } from "../state/alerts";
import { acknowledge, goLive, select } from "../state/session";
import { store, useStore } from "../state/store";
import { behind_s, LATE_S, silence_s } from "../state/time";
import { dayAndTime, duration, withTimes } from "../text/stamp";
import { Icon } from "./icons";
import { useNow } from "./now";
import { mayOperate } from "./operator";

export function Banner() {
  useNow();
  const unknown = useStore((state) => state.unknown);
  const connected = useStore((state) => state.connected);
  const moment = useStore((state) => state.moment);
  const time = useStore((state) => state.time);
  const clock = useStore((state) => state.clock);
  const alerts = useStore((state) => state.alerts);
  const urgent = alerts.filter((alert) => alert.level !== "info" && !alert.acknowledged_by && !alert.cleared_ms);
  const worst = urgent.find(({ level }) => level === "alarm") ?? urgent[0];
  const newest_ms = useStore((state) => state.timeline.points.at(-1)?.stamp_ms ?? 0);
  const late_s = silence_s(store.state);
  const old_s = behind_s(store.state);
  return (
    <div class="banners" aria-live="polite">
      {moment && !connected && (
        <div class="banner alarm" data-test="offline">
          <Icon name="warning" />
          <span>
            <b>{unknown ? "The service no longer knows your token." : "The connection to the service is lost."}</b> The map shows{" "}
            {dayAndTime(moment.stamp_ms, clock, Date.now())}; zones stay closed. {unknown ? "Open the page once as /?token=… with one that it knows." : "Connecting again…"}
          </span>
        </div>
      )}
      {connected && late_s > LATE_S && (
        <div class="banner alarm">
          <Icon name="warning" />
          <span>
            <b>
              No view has arrived for <Counting seconds={late_s} />.
            </b> What the map shows is that old; zones stay closed.
          </span>
        </div>
      )}
      {connected && late_s <= LATE_S && old_s > LATE_S && (
        <div class="banner warning" data-test="behind">
          <Icon name="warning" />
          <span>
            <b>
              The map is <Counting seconds={old_s} /> behind.
            </b> More views come than the service can take in, or they come late.
          </span>
        </div>
      )}
      {moment && !time.following && (
        <div class="banner past" data-test="past">
          <span>
            You are looking at <b>{dayAndTime(moment.stamp_ms, clock, newest_ms)}</b>, not at now.
          </span>
          <button onClick={goLive}>Go to the newest</button>
        </div>
      )}
      {urgent.length > 0 && <AlertBanner alert={worst} more={urgent.length - 1} />}
    </div>
  );
}

/** Read out with its sentence, and not again each time that it has grown. */
function Counting({ seconds }: { seconds: number }) {
  return <span aria-live="off">{duration(seconds)}</span>;
}

function AlertBanner({ alert, more }: { alert: Alert; more: number }) {
  const now = useNow();
  const scene = useStore((state) => state.scene);
  const clock = useStore((state) => state.clock);
  const operator = mayOperate(scene);
  const subject = subjectOf(alert);
  return (
    <div class={`banner ${alert.level}`}>
      <Icon name="warning" />
      <span>{withTimes(alert.text, clock, now)}</span>
      {subject && <button onClick={() => select(subject)}>Show</button>}
      <button disabled={!operator} title={operator ? "" : "Acknowledging needs the role operator"} onClick={() => acknowledge(alert.id)}>
        Acknowledge
      </button>
      {more > 0 && (
        <button class="quiet" onClick={() => store.set({ panel: "alerts" })}>
          {more} more
        </button>
      )}
    </div>
  );
}
