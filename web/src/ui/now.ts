// Redraws what shows ages and count-downs.

import { useEffect, useRef, useState } from "preact/hooks";
import { store } from "../state/store";
import { now_ms } from "../state/time";

const EVERY_MS = 250;

/** Calls with what tells the time of the page, and a few times a second beside it; not when the camera moves. */
function onNow(update: () => void): () => void {
  let before = store.state;
  const timer = window.setInterval(update, EVERY_MS);
  const end = store.subscribe((state) => {
    const { moment, time, mode } = before;
    before = state;
    if (moment !== state.moment || time !== state.time || mode !== state.mode) update();
  });
  return () => {
    window.clearInterval(timer);
    end();
  };
}

/** Redraws a component with the moment, and a few times a second beside it. */
export function useNow(): number {
  const [now, setNow] = useState(() => now_ms(store.state));
  useEffect(() => onNow(() => setNow(now_ms(store.state))), []);
  return now;
}

/** Redraws a component where what is told of now has changed: of thousands of zones few count down. */
export function useTold<T>(tell: (now_ms: number) => T): T {
  const latest = useRef(tell);
  latest.current = tell;
  const told = tell(now_ms(store.state));
  const [, setText] = useState(() => JSON.stringify(told));
  useEffect(() => onNow(() => setText(JSON.stringify(latest.current(now_ms(store.state))))), []);
  return told;
}
