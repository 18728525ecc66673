// "Now" for ages and count-downs: the stamp of what is shown; the time of the service while the page follows live data.

import { useEffect, useState } from "preact/hooks";
import { store, type State } from "../state/store";

export function now_ms(state: State): number {
  const { moment, time, mode } = state;
  if (!moment) return 0;
  const runs = time.following && mode === "live";
  return moment.stamp_ms + (runs ? 1000 * (moment.lag_s ?? 0) + performance.now() - moment.arrived : 0);
}

/** How old the newest moment was when it arrived: views that wait in the service make the map late. */
export function behind_s(state: State): number {
  const { moment, time, mode } = state;
  return moment && time.following && mode === "live" ? (moment.lag_s ?? 0) : 0;
}

/** Seconds since the service last said anything about the map; only live data can be late. */
export function silence_s(state: State): number {
  const { moment, time, mode } = state;
  return moment && time.following && mode === "live" ? (performance.now() - moment.arrived) / 1000 : 0;
}

/** Redraws a component with the state, and a few times a second beside it. */
export function useNow(): number {
  const [now, setNow] = useState(() => now_ms(store.state));
  useEffect(() => {
    const update = () => setNow(now_ms(store.state));
    const timer = window.setInterval(update, 250);
    const end = store.subscribe(update);
    return () => {
      window.clearInterval(timer);
      end();
    };
  }, []);
  return now;
}
