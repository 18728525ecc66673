// Stamps: nanoseconds as decimal strings, because a JS number cannot hold them; milliseconds for drawing.

export type Clock = "utc" | "local";

/** Order of two stamps; strings of digits of different length do not compare as text. */
export function compareStamps(a: string, b: string): number {
  const left = BigInt(a);
  const right = BigInt(b);
  return left < right ? -1 : left > right ? 1 : 0;
}

/** Index of the last point at or before `stamp_ms`, or 0 where there is none; points are in order. */
export function indexAt(points: readonly { stamp_ms: number }[], stamp_ms: number): number {
  let low = 0;
  let high = points.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (points[middle].stamp_ms <= stamp_ms) low = middle + 1;
    else high = middle;
  }
  return Math.max(low - 1, 0);
}

/** 12:41:07.3 on the clock asked for. */
export function timeOfDay(stamp_ms: number, clock: Clock, digits = 1): string {
  const shown = clock === "utc" ? stamp_ms : stamp_ms - new Date(stamp_ms).getTimezoneOffset() * 60_000;
  const cut = new Date(shown).toISOString().slice(11, 23);
  return digits === 0 ? cut.slice(0, 8) : cut.slice(0, 9 + digits);
}

/** With the date where that is another than the day of `today_ms`: yesterday's time is not taken for today's. */
export function dayAndTime(stamp_ms: number, clock: Clock, today_ms: number, digits = 1): string {
  const day = dateOf(stamp_ms, clock);
  return `${day === dateOf(today_ms, clock) ? "" : `${day} `}${timeOfDay(stamp_ms, clock, digits)}`;
}

/** Stamps within a sentence, as the service writes them, on the clock asked for. */
export function withTimes(text: string, clock: Clock, today_ms: number): string {
  return text.replace(/\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d(\.\d+)?Z/g, (stamp) => {
    const stamp_ms = Date.parse(stamp.replace(/(\.\d{3})\d+Z$/, "$1Z"));
    return Number.isNaN(stamp_ms) ? stamp : `${dayAndTime(stamp_ms, clock, today_ms, 0)} ${clock === "utc" ? "UTC" : "local time"}`;
  });
}

/** 2026-01-01 on the clock asked for. */
export function dateOf(stamp_ms: number, clock: Clock): string {
  const shown = clock === "utc" ? stamp_ms : stamp_ms - new Date(stamp_ms).getTimezoneOffset() * 60_000;
  return new Date(shown).toISOString().slice(0, 10);
}

/** A length of time as people say it: 0.4 s, 12 s, 3 min 05 s, 2 h 10 min. */
export function duration(seconds: number): string {
  const whole = Math.max(seconds, 0);
  if (whole < 9.95) return `${whole.toFixed(1)} s`;
  if (whole < 99.5) return `${Math.round(whole)} s`;
  const rounded = Math.round(whole);
  if (rounded < 3600) return `${Math.floor(rounded / 60)} min ${String(rounded % 60).padStart(2, "0")} s`;
  const hours = Math.floor(rounded / 3600);
  if (hours < 48) return `${hours} h ${String(Math.floor((rounded % 3600) / 60)).padStart(2, "0")} min`;
  return `${Math.floor(hours / 24)} days`;
}

export function ago(then_ms: number | null, now_ms: number): string {
  if (then_ms === null) return "never";
  const seconds = (now_ms - then_ms) / 1000;
  return seconds < 0.05 ? "just now" : `${duration(seconds)} ago`;
}

/** How a zone ends: a count-down where the method knows an end, otherwise what opens it. */
export function endOf(valid_until_ms: number | null, now_ms: number): { text: string; counts: boolean } {
  if (valid_until_ms === null) return { text: "until looked at", counts: false };
  const left_s = (valid_until_ms - now_ms) / 1000;
  // A zone that is past its end stays on the map until the service says that it is open.
  return left_s > 0 ? { text: duration(left_s), counts: true } : { text: "end is due", counts: true };
}
