// Lengths, areas and places as text. Metres inside, always; feet only here.

import type { Anchor, Place } from "../api/contract";
import { ellipsoidalHeight, geodetic } from "../map/earth";

export type Units = "metres" | "feet";

const FEET = 1 / 0.3048;

export function length(metres: number, units: Units, digits = 0): string {
  return units === "metres"
    ? `${grouped(metres, digits)} m`
    : `${grouped(metres * FEET, digits)} ft`;
}

/** Heights that others gave no upper end reach to here (`static_zones/given_zone.py`). */
const NO_CEILING_M = 99_999;

export function heights({ lower_m, upper_m, datum }: { lower_m: number; upper_m: number; datum: string }, units: Units): string {
  if (upper_m >= NO_CEILING_M) return `from ${length(lower_m, units)} ${datum} up, without a ceiling`;
  return `${length(lower_m, units)} to ${length(upper_m, units)} ${datum}`;
}

export function area(square_metres: number, units: Units): string {
  const [value, unit] = units === "metres" ? [square_metres, "m²"] : [square_metres * FEET * FEET, "ft²"];
  // A small crowd is not told as none.
  const text = value > 0 && value < 1 ? String(Number(value.toPrecision(2))) : grouped(value, value > 0 && value < 10 ? 1 : 0);
  return `${text} ${unit}`;
}

/** 12 532: a thin space every three digits, which no reader takes for a decimal sign. */
export function grouped(value: number, digits = 0): string {
  const [whole, rest] = Math.abs(value).toFixed(digits).split(".");
  const spaced = whole.replace(/\B(?=(\d{3})+$)/g, "\u2009");
  const sign = value < 0 && Number(value.toFixed(digits)) !== 0 ? "−" : "";
  return `${sign}${spaced}${rest ? `.${rest}` : ""}`;
}

/** A probability; never shown as 0 or 1 unless it is. */
export function probability(value: number | null): string {
  if (value === null || Number.isNaN(value)) return "not known";
  if (value > 0 && value < 0.001) return "< 0.001";
  if (value < 1 && value > 0.999) return "> 0.999";
  return value.toFixed(value < 0.1 ? 3 : 2);
}

/** Beyond the antimeridian east is west. */
export function degrees(latitude: number, longitude: number): string {
  if (Math.abs(longitude) > 180) longitude -= Math.sign(longitude) * 360;
  const north = `${Math.abs(latitude).toFixed(5)}° ${latitude < 0 ? "S" : "N"}`;
  return `${north} ${Math.abs(longitude).toFixed(5)}° ${longitude < 0 ? "W" : "E"}`;
}

/** Where it is, in words that lead there: degrees with an anchor, local metres without. */
export function place(east: number, north: number, anchor: Anchor | null, units: Units): string {
  if (anchor) return degrees(...geodetic(east, north, 0, anchor));
  return `E ${length(east, units)}  N ${length(north, units)}`;
}

/** How high it is: above the ellipsoid with an anchor, local metres without. */
export function height([east, north, up]: Place, anchor: Anchor | null, units: Units): string {
  return length(anchor ? ellipsoidalHeight(east, north, up, anchor) : up, units);
}
