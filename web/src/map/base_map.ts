// The operator's own map of the surroundings, asked for once per theme; the map stands without it until it is there.

import { baseMapAddress, baseMapPictureAddress, image } from "../api/client";
import type { Anchor, Scene } from "../api/contract";
import type { Store } from "../state/store";
import { css, type Palette, type Theme } from "./colours";
import type { DrapeFrame } from "./drape";
import type { Bounds } from "./geometry";
import { cutOut, extentOf, shareAt, sheetBounds, sheetMesh } from "./surroundings";
import type { Mesh } from "./terrain_mesh";

const PICTURE_PIXELS = 2048;
/** A photograph stays behind what drones saw; tiles are drawn quietly at once. */
const MUTED: Record<Theme, string> = {
  dark: "saturate(0.4) brightness(0.8)",
  light: "saturate(0.4) contrast(0.8) brightness(1.15)",
};

interface Sheet {
  mesh: Mesh;
  texture: ImageBitmap;
}

/** A picture and where in it the ground lies: left, top, width, height. */
interface OnGround {
  picture: ImageBitmap;
  from: [number, number, number, number];
}

export class BaseMap {
  sheet: Sheet | null = null;
  private ground: OnGround | null = null;
  private asked = "";

  constructor(
    private readonly store: Store,
    private readonly onDrawn: () => void,
  ) {}

  /** Asks for what is not there yet; `floor_m` is where the block of ground stands. */
  ask(scene: Scene, bounds: Bounds, floor_m: number, theme: Theme, wanted: boolean): void {
    const { base_map, anchor, run } = scene;
    const key = `${run} ${base_map} ${theme} ${bounds}`;
    if (!wanted || !base_map || !anchor || key === this.asked) return;
    this.asked = key;
    const drawn = base_map === "tiles" ? this.drawTiles(run, bounds, floor_m, anchor, theme) : this.drawPicture(run, bounds, floor_m, theme);
    drawn
      .then((attribution) => {
        if (key !== this.asked) return;
        this.store.set({ attribution });
        this.onDrawn();
      })
      // The page is whole without it, so the reason is for whoever looks into the browser.
      .catch((error) => console.error("The base map cannot be drawn:", error));
  }

  private async drawTiles(run: string, bounds: Bounds, floor_m: number, anchor: Anchor, theme: Theme): Promise<string> {
    const { drawTiles } = await import("./base_tiles");
    const around = sheetBounds(bounds);
    const [wide, near] = [extentOf(around, anchor), extentOf(bounds, anchor)];
    const { pictures, attribution } = await drawTiles(baseMapAddress(run), [wide, near], theme);
    this.sheet = { mesh: sheetMesh(around, floor_m, (east, north) => shareAt(east, north, wide, anchor)), texture: pictures[0] };
    this.ground = { picture: pictures[1], from: cutOut(bounds, near, anchor, pictures[1].width, pictures[1].height) };
    return attribution;
  }

  private async drawPicture(run: string, bounds: Bounds, floor_m: number, theme: Theme): Promise<string> {
    const around = sheetBounds(bounds);
    const [wide, near] = await Promise.all([this.pictureOf(run, around, theme), this.pictureOf(run, bounds, theme)]);
    if (!wide || !near) throw new Error("the service gives no picture");
    const share = (east: number, north: number): [number, number] => [(east - around[0]) / (around[2] - around[0]), (around[3] - north) / (around[3] - around[1])];
    this.sheet = { mesh: sheetMesh(around, floor_m, share), texture: wide };
    this.ground = { picture: near, from: [0, 0, near.width, near.height] };
    return "";
  }

  private async pictureOf(run: string, bounds: Bounds, theme: Theme): Promise<ImageBitmap | null> {
    const [width_m, height_m] = [bounds[2] - bounds[0], bounds[3] - bounds[1]];
    const pixel_m = Math.max(width_m, height_m) / PICTURE_PIXELS;
    const picture = await image(baseMapPictureAddress(run, bounds, Math.max(Math.round(height_m / pixel_m), 1), Math.max(Math.round(width_m / pixel_m), 1)));
    if (!picture) return null;
    const canvas = new OffscreenCanvas(picture.width, picture.height);
    const context = canvas.getContext("2d")!;
    context.filter = MUTED[theme];
    context.drawImage(picture, 0, 0);
    return canvas.transferToImageBitmap();
  }

  /** Colours of the ground, pixel by pixel of the drape; where the file has nothing it is grey as without it. */
  pixels(frame: DrapeFrame, palette: Palette): Uint8ClampedArray<ArrayBuffer> | null {
    if (!this.ground) return null;
    const context = new OffscreenCanvas(frame.width, frame.height).getContext("2d", { willReadFrequently: true })!;
    context.fillStyle = css(palette.shade[1]);
    context.fillRect(0, 0, frame.width, frame.height);
    context.drawImage(this.ground.picture, ...this.ground.from, 0, 0, frame.width, frame.height);
    return context.getImageData(0, 0, frame.width, frame.height).data as Uint8ClampedArray<ArrayBuffer>;
  }
}
