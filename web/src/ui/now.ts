// Redraws what shows ages and count-downs.

import { useEffect, useState } from "preact/hooks";
import { store } from "../state/store";
import { now_ms } from "../state/time";

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
