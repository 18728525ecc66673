// How long the page has been open. A machine that sleeps stops the page's own clock, not the one on the wall.

/** The two clocks may differ by so much more from one look to the next before that is a sleep. */
const ASLEEP_MS = 4_000;

const ahead_ms = () => Date.now() - performance.now();
let before_ms = ahead_ms();
let asleep_ms = 0;

/** How much of it the machine slept. A clock on the wall that is set on counts too: what is shown may be that old. */
export function slept_ms(): number {
  const jump_ms = ahead_ms() - before_ms;
  before_ms += jump_ms;
  if (jump_ms > ASLEEP_MS) asleep_ms += jump_ms;
  return asleep_ms;
}

/** `performance.now()` that goes on while the machine sleeps. */
export const elapsed_ms = () => performance.now() + slept_ms();
