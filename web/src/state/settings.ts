// What a viewer chose stays chosen on this machine.

import type { Theme } from "../map/colours";
import type { Clock } from "../text/stamp";
import type { Units } from "../text/units";

const KEY = "crowdfence";

export interface Settings {
  theme: Theme;
  units: Units;
  clock: Clock;
}

function preferred(): Settings {
  const light = window.matchMedia?.("(prefers-color-scheme: light)").matches;
  return { theme: light ? "light" : "dark", units: "metres", clock: "utc" };
}

export function readSettings(): Settings {
  const settings = preferred();
  try {
    const kept = JSON.parse(localStorage.getItem(KEY) ?? "{}");
    if (kept.theme === "dark" || kept.theme === "light") settings.theme = kept.theme;
    if (kept.units === "metres" || kept.units === "feet") settings.units = kept.units;
    if (kept.clock === "utc" || kept.clock === "local") settings.clock = kept.clock;
  } catch {
    // A browser that keeps nothing, or kept nonsense: the preferences of the machine do.
  }
  return settings;
}

export function keepSettings(settings: Settings): void {
  try {
    localStorage.setItem(KEY, JSON.stringify(settings));
  } catch {
    // Nothing is lost but the choice.
  }
}
