// Newest picture of every drone with its heatmap over it.

import { useEffect, useRef, useState } from "preact/hooks";
import { heatmapAddress, pictureAddress, stampedImage, type At } from "../api/client";
import type { Drone } from "../api/contract";
import { css, crowdColour, droneColour, PALETTES } from "../map/colours";
import { select } from "../state/session";
import { pauseOf } from "../state/pace";
import { standingOf } from "../state/standing";
import { useStore } from "../state/store";
import { LATE_S } from "../state/time";
import { ago, compareStamps } from "../text/stamp";
import { useNow } from "./now";

let cameras = 0;

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
    <button class={`camera ${chosen ? "chosen" : ""} ${standingOf(drone)}`} onClick={() => select({ kind: "drone", id: drone.drone })}>
      <CameraPicture drone={drone} heat={0.75} />
      <span class="camera-name" title={drone.drone}>
        <i style={{ background: colour }} />
        <b>{drone.drone}</b>
        <small>{drone.left_out ? "left out" : drone.status === "ok" ? "" : ago(drone.stamp_ms, now)}</small>
      </span>
    </button>
  );
}

/** The picture of the moment shown; at most one question at a time per drone. */
export function CameraPicture({ drone, heat }: { drone: Drone; heat: number }) {
  const canvas = useRef<HTMLCanvasElement>(null);
  const [taken_ms, setTaken] = useState<number | null | undefined>();
  const time = useStore((state) => state.time);
  const scene = useStore((state) => state.scene);
  const now = useNow();
  const at = time.following ? null : time.stamp_ns;
  const wanted = { drone, at, heat, key: `${drone.drone} ${at ?? ""} ${drone.stamp_ns} ${heat}` };
  const state = useRef({ busy: false, wanted, shown: "" });
  useEffect(() => {
    cameras++;
    return () => void cameras--;
  }, []);
  useEffect(() => {
    const hand = state.current;
    hand.wanted = wanted;
    if (hand.busy) return;
    hand.busy = true;
    const draw = async () => {
      while (hand.wanted.key !== hand.shown) {
        const now = hand.wanted;
        const seen = await askSeen(now.drone, now.at, now.heat > 0);
        hand.shown = now.key;
        if (!canvas.current) return;
        setTaken(seen.stamp_ns === null ? null : Number(BigInt(seen.stamp_ns) / 1_000_000n));
        paint(canvas.current, seen.picture, seen.heatmap, now.heat);
        await new Promise((resolve) => window.setTimeout(resolve, pauseOf(cameras)));
      }
    };
    void draw().finally(() => (hand.busy = false));
  }, [wanted.key]);
  // On a slow line the drone has long sent other views.
  const isOld = taken_ms != null && (drone.stamp_ms ?? 0) - taken_ms > 1000 * (scene?.silent_after_s ?? LATE_S);
  return (
    <span class="camera-picture">
      <canvas ref={canvas} width={320} height={240} />
      {taken_ms === null && <em>no picture</em>}
      {isOld && <small class="taken">taken {ago(taken_ms, now)}</small>}
    </span>
  );
}

/** Picture and heatmap of one instant: where another came while they were asked for, those of the older one. */
async function askSeen(drone: Drone, at: At, heated: boolean): Promise<{ picture: ImageBitmap | null; heatmap: ImageBitmap | null; stamp_ns: string | null }> {
  const askPicture = (at: At) => (drone.picture ? stampedImage(pictureAddress(drone.drone, at)) : null);
  const askHeatmap = (at: At) => (drone.heatmap && heated ? stampedImage(heatmapAddress(drone.drone, at)) : null);
  let [picture, heatmap] = await Promise.all([askPicture(at), askHeatmap(at)]);
  if (picture && heatmap && picture.stamp_ns !== heatmap.stamp_ns) {
    if (compareStamps(picture.stamp_ns, heatmap.stamp_ns) < 0) heatmap = await askHeatmap(picture.stamp_ns);
    else picture = await askPicture(heatmap.stamp_ns);
  }
  if (picture && heatmap && picture.stamp_ns !== heatmap.stamp_ns) heatmap = null;
  return { picture: picture?.bitmap ?? null, heatmap: heatmap?.bitmap ?? null, stamp_ns: (picture ?? heatmap)?.stamp_ns ?? null };
}

/** Values become crowd colours whose opacity is the value, so that nothing is hidden where nothing was found. */
function paint(canvas: HTMLCanvasElement, picture: ImageBitmap | null, heatmap: ImageBitmap | null, heat: number): void {
  const context = canvas.getContext("2d")!;
  context.clearRect(0, 0, canvas.width, canvas.height);
  const size = picture ?? heatmap;
  if (!size) return;
  const scale = Math.min(1, 640 / size.width);
  const ratio = picture ? picture.height / picture.width : size.height / size.width;
  canvas.width = picture ? Math.round(size.width * scale) : 320;
  canvas.height = Math.round(canvas.width * ratio);
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
