// How the base map looks: quiet, so that nothing on it is taken for something that drones saw.

import type { LayerSpecification, StyleSpecification } from "maplibre-gl";
import type { Theme } from "./colours";

interface Hues {
  land: string;
  green: string;
  water: string;
  road: string;
  building: string;
}

const HUES: Record<Theme, Hues> = {
  dark: { land: "#3a4149", green: "#37463f", water: "#2a4358", road: "#747d87", building: "#565f69" },
  light: { land: "#dfe2e1", green: "#cbd9cd", water: "#b3cddf", road: "#ffffff", building: "#c3c6c9" },
};

const GREY: Record<Theme, Record<string, number>> = {
  dark: { "raster-saturation": -0.6, "raster-brightness-max": 0.8, "raster-contrast": -0.1 },
  light: { "raster-saturation": -0.6, "raster-brightness-min": 0.25 },
};

/** What the layers of vector tiles are called in the schemas of Protomaps, OpenMapTiles and Shortbread; drawn in this order. */
const KINDS: [keyof Hues, RegExp][] = [
  ["green", /^(land(use|cover)?|sites|park|wood|forest|green)/],
  ["water", /^(water|ocean|sea|lake|river)/],
  ["road", /^(road|street|transport|highway|rail|aeroway|pier|bridge)/],
  ["building", /^building/],
];

const SOURCE = "base";

export function rasterStyle(archive: string, theme: Theme): StyleSpecification {
  return {
    version: 8,
    sources: { [SOURCE]: { type: "raster", url: `pmtiles://${archive}`, tileSize: 256 } },
    layers: [{ id: "picture", type: "raster", source: SOURCE, paint: { ...GREY[theme], "raster-fade-duration": 0 } }],
  };
}

/** `names` are the layers that the archive says it has; what has no colour here is left out. */
export function vectorStyle(archive: string, names: readonly string[], theme: Theme): StyleSpecification {
  const hues = HUES[theme];
  const layers: LayerSpecification[] = [{ id: "land", type: "background", paint: { "background-color": hues.land } }];
  for (const [kind, called] of KINDS) {
    for (const name of names.filter((one) => called.test(one) && !/label|name|poi|point/.test(one))) {
      const from = { source: SOURCE, "source-layer": name };
      if (kind !== "road") {
        layers.push({ id: `${name}-areas`, type: "fill", ...from, filter: ["==", ["geometry-type"], "Polygon"], paint: { "fill-color": hues[kind] } });
      }
      if (kind === "road" || kind === "water") {
        const width = ["interpolate", ["exponential", 1.7], ["zoom"], 12, 0.8, 19, kind === "road" ? 14 : 6] as never;
        layers.push({ id: `${name}-lines`, type: "line", ...from, filter: ["==", ["geometry-type"], "LineString"], layout: { "line-cap": "round", "line-join": "round" }, paint: { "line-color": hues[kind], "line-width": width } });
      }
    }
  }
  return { version: 8, sources: { [SOURCE]: { type: "vector", url: `pmtiles://${archive}` } }, layers };
}
