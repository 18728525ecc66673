// How often cameras ask for what they show: the service takes 100 questions a second of one user, on all pages together.

const EVERY_MS = 400;
/** Of a camera, which asks for its picture and its heatmap: 25 questions a second of a page, however many there are. */
const EACH_MS = 80;

/** From one answer to the next question of every camera, of so many. */
export const pauseOf = (cameras: number): number => Math.max(EVERY_MS, EACH_MS * cameras);
