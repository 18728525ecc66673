// Newest picture of every drone with its heatmap over it.

import { useEffect, useRef, useState } from "preact/hooks";
import { heatmapAddress, image, pictureAddress } from "../api/client";
import type { Drone } from "../api/contract";
import { css, crowdColour, droneColour, PALETTES } from "../map/colours";
import { select } from "../state/session";
import { store, useStore } from "../state/store";
import { ago } from "../text/stamp";
import { useNow } from "./now";

const EVERY_MS = 400;

export function CameraStrip() {
  const moment = useStore((state) => state.moment);
  const drones = (moment?.drones ?? [])
    .filter((drone) => drone.picture || drone.heatmap)
    .sort((a, b) => a.drone.localeCompare(b.drone, "en", { numeric: true }));
  if (!drones.length) return null;
  return (
    <div class="strip" data-test="strip">
      {drones.map((drone) => (
        <Camera key={drone.drone} drone={drone} />
      ))}
    </div>
  );
}

function Camera({ drone }: { drone: Drone }) {
  const now = useNow();
  const scene = useStore((state) => state.scene);
  const theme = useStore((state) => state.theme);
  const selection = useStore((state) => state.selection);
  const chosen = selection?.kind === "drone" && selection.id === drone.drone;
  const colour = css(droneColour(PALETTES[theme], scene?.drones ?? [], drone.drone));
  return (
    <button class={`camera ${chosen ? "chosen" : ""} ${drone.status}`} onClick={() => select({ kind: "drone", id: drone.drone })}>
      <CameraPicture drone={drone} heat={0.75} />
      <span class="camera-name" title={drone.drone}>
        <i style={{ background: colour }} />
        <b>{drone.drone}</b>
        <small>{drone.status === "ok" ? "" : ago(drone.stamp_ms, now)}</small>
      </span>
    </button>
  );
}

/** The picture of the moment shown; at most one question at a time per drone. */
export function CameraPicture({ drone, heat }: { drone: Drone; heat: number }) {
  const canvas = useRef<HTMLCanvasElement>(null);
  const [missing, setMissing] = useState(false);
  const time = useStore((state) => state.time);
  const state = useRef({ busy: false, wanted: "", shown: "" });
  const at = time.following ? null : time.stamp_ns;
  const wanted = `${drone.drone} ${at ?? ""} ${drone.stamp_ns} ${heat}`;
  useEffect(() => {
    const hand = state.current;
    hand.wanted = wanted;
    if (hand.busy) return;
    hand.busy = true;
    const draw = async () => {
      while (hand.wanted !== hand.shown) {
        const now = hand.wanted;
        const newest = store.state.time.following ? null : store.state.time.stamp_ns;
        const [picture, heatmap] = await Promise.all([
          drone.picture ? image(pictureAddress(drone.drone, newest)) : null,
          drone.heatmap && heat > 0 ? image(heatmapAddress(drone.drone, newest)) : null,
        ]);
        hand.shown = now;
        if (!canvas.current) return;
        setMissing(!picture && !heatmap);
        paint(canvas.current, picture, heatmap, heat);
        await new Promise((resolve) => window.setTimeout(resolve, EVERY_MS));
      }
    };
    void draw().finally(() => (hand.busy = false));
  }, [wanted]);
  return (
    <span class="camera-picture">
      <canvas ref={canvas} width={320} height={240} />
      {missing && <em>no picture</em>}
    </span>
  );
}

/** Values become crowd colours whose opacity is the value, so that nothing is hidden where nothing was found. */
function paint(canvas: HTMLCanvasElement, picture: ImageBitmap | null, heatmap: ImageBitmap | null, heat: number): void {
  const size = picture ?? heatmap;
  if (!size) return;
  const scale = Math.min(1, 640 / size.width);
  const ratio = picture ? picture.height / picture.width : size.height / size.width;
  canvas.width = picture ? Math.round(size.width * scale) : 320;
  canvas.height = Math.round(canvas.width * ratio);
  const context = canvas.getContext("2d")!;
  context.clearRect(0, 0, canvas.width, canvas.height);
  if (picture) context.drawImage(picture, 0, 0, canvas.width, canvas.height);
  if (!heatmap) return;
  const small = new OffscreenCanvas(heatmap.width, heatmap.height);
  const inner = small.getContext("2d", { willReadFrequently: true })!;
  inner.drawImage(heatmap, 0, 0);
  const values = inner.getImageData(0, 0, heatmap.width, heatmap.height);
  for (let k = 0; k < values.data.length; k += 4) {
    const value = values.data[k] / 255;
    const [red, green, blue] = crowdColour(value, 0.05);
    values.data.set([red, green, blue, value < 0.05 ? 0 : Math.round(255 * heat * Math.min(0.25 + value, 1))], k);
  }
  inner.putImageData(values, 0, 0);
  context.drawImage(small, 0, 0, canvas.width, canvas.height);
}
