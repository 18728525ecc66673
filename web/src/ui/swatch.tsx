// The legend is painted by the code that paints the map, so that they cannot differ.

import { useEffect, useRef } from "preact/hooks";
import { VoxelState } from "../map/belief";
import { crowdColour, crowdMark, css, marked, opacity, PALETTES, type Theme } from "../map/colours";
import { mixed } from "../map/colours";

const WIDTH = 44;
const HEIGHT = 28;

export function StateSwatch({ state, theme }: { state: VoxelState; theme: Theme }) {
  const canvas = useRef<HTMLCanvasElement>(null);
  useEffect(() => {
    const context = canvas.current?.getContext("2d");
    if (!context) return;
    const palette = PALETTES[theme];
    const ground = mixed(palette.shade[0], palette.shade[1], 0.7);
    const alpha = opacity(state, 0, 30);
    for (let y = 0; y < HEIGHT; y++) {
      for (let x = 0; x < WIDTH; x++) {
        const never = state === 0 && !marked(state, x, y, 10);
        const colour = marked(state, x, y, 10) ? (state === 0 ? palette.hatch : palette.marks[state]) : palette.states[state];
        context.fillStyle = css(mixed(ground, colour, never ? 0.3 : state === 0 ? 0.6 : alpha));
        context.fillRect(x, y, 1, 1);
      }
    }
  }, [state, theme]);
  return <canvas ref={canvas} width={WIDTH} height={HEIGHT} class="swatch" />;
}

export function RampSwatch() {
  const canvas = useRef<HTMLCanvasElement>(null);
  useEffect(() => {
    const context = canvas.current?.getContext("2d");
    if (!context) return;
    for (let x = 0; x < 200; x++) {
      const colour = crowdColour(x / 199, 0);
      for (let y = 0; y < 10; y++) {
        context.fillStyle = css(marked(VoxelState.crowd, x, y, 10) ? crowdMark(colour) : colour);
        context.fillRect(x, y, 1, 1);
      }
    }
  }, []);
  return <canvas ref={canvas} width={200} height={10} class="ramp-swatch" />;
}
