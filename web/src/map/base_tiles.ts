// MapLibre draws the archive of tiles once per theme, as pictures. It is a megabyte, so only pages with tiles load it.

import { addProtocol, Map as WebMap, setWorkerUrl } from "maplibre-gl";
import workerUrl from "maplibre-gl/dist/maplibre-gl-worker.mjs?worker&url";
import { PMTiles, Protocol, TileType } from "pmtiles";
import { rasterStyle, vectorStyle } from "./base_style";
import type { Theme } from "./colours";
import type { Extent } from "./surroundings";

/** A side of a picture at most: software rendering draws that in seconds. */
const MOST_PIXELS = 1536;
const FINEST_M = 0.25;
const EQUATOR_LENGTH_M = 40_075_017;
const LONGEST_WAIT_MS = 30_000;
/** MapLibre's world is so many pixels wide at zoom 0. */
const WORLD_PIXELS = 512;

export interface Drawn {
  pictures: ImageBitmap[];
  /** Whom to thank, as text. */
  attribution: string;
}

const protocol = new Protocol({ metadata: true });
let ready = false;

function prepare(): void {
  if (ready) return;
  setWorkerUrl(workerUrl);
  addProtocol("pmtiles", protocol.tile);
  ready = true;
}

/** One picture per extent, north up. Throws where the archive cannot be read. */
export async function drawTiles(address: string, extents: readonly Extent[], theme: Theme): Promise<Drawn> {
  prepare();
  const archive = new PMTiles(new URL(address, location.href).href);
  protocol.add(archive);
  const [{ tileType }, metadata] = await Promise.all([archive.getHeader(), archive.getMetadata() as Promise<Metadata>]);
  const names = (metadata.vector_layers ?? []).map(({ id }) => id);
  const key = archive.source.getKey();
  const style = tileType === TileType.Mvt ? vectorStyle(key, names, theme) : rasterStyle(key, theme);
  const pictures: ImageBitmap[] = [];
  for (const extent of extents) pictures.push(await drawn(style, extent));
  return { pictures, attribution: plain(metadata.attribution ?? "") };
}

interface Metadata {
  attribution?: string;
  vector_layers?: { id: string }[];
}

/** Attributions come as HTML, which this page does not let in. */
function plain(html: string): string {
  return new DOMParser().parseFromString(html, "text/html").body.textContent?.trim() ?? "";
}

async function drawn(style: ReturnType<typeof rasterStyle>, { west, north, east, south }: Extent): Promise<ImageBitmap> {
  const longer = Math.max(east - west, south - north);
  const most = Math.min(MOST_PIXELS, (longer * EQUATOR_LENGTH_M) / FINEST_M);
  const [width, height] = [east - west, south - north].map((side) => Math.max(Math.round((side / longer) * most), 1));
  const container = document.createElement("div");
  Object.assign(container.style, { position: "fixed", left: "-10000px", top: "0", width: `${width}px`, height: `${height}px` });
  document.body.append(container);
  const map = new WebMap({
    container,
    style,
    center: placeAt((west + east) / 2, (north + south) / 2),
    zoom: Math.log2(width / (WORLD_PIXELS * (east - west))),
    maxZoom: 24,
    pixelRatio: 1,
    maxCanvasSize: [MOST_PIXELS, MOST_PIXELS],
    interactive: false,
    attributionControl: false,
    fadeDuration: 0,
    canvasContextAttributes: { preserveDrawingBuffer: true },
  });
  try {
    await new Promise<void>((resolve) => {
      map.once("idle", () => resolve());
      window.setTimeout(resolve, LONGEST_WAIT_MS); // then as much as has come
    });
    return await createImageBitmap(map.getCanvas());
  } finally {
    map.remove();
    container.remove();
  }
}

/** Longitude and latitude of a place in the square of web maps. */
function placeAt(x: number, y: number): [number, number] {
  return [(x - 0.5) * 360, (Math.atan(Math.sinh(Math.PI * (1 - 2 * y))) * 180) / Math.PI];
}
