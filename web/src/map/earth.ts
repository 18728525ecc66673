// Local east-north-up metres -> places on Earth, and from there -> the square of web maps.

import type { Anchor } from "../api/contract";

const EQUATOR_M = 6_378_137;
const SQUARED_ECCENTRICITY = 6.694_379_990_14e-3;
const DEGREE = Math.PI / 180;

/** WGS84 degrees of a local place: the frame is a tangent plane, so it goes through Earth-centred coordinates. */
export function geodetic(east: number, north: number, up: number, anchor: Anchor): [latitude: number, longitude: number] {
  const [latitude, longitude] = onEllipsoid(east, north, up, anchor);
  return [latitude, longitude];
}

/** Height of a local place above the ellipsoid of WGS84, which the plane leaves to all sides: by 8 m at 10 km. */
export function ellipsoidalHeight(east: number, north: number, up: number, anchor: Anchor): number {
  return onEllipsoid(east, north, up, anchor)[2];
}

function onEllipsoid(east: number, north: number, up: number, anchor: Anchor): [latitude: number, longitude: number, height_m: number] {
  const latitude = anchor.latitude_deg * DEGREE;
  const [sin, cos] = [Math.sin(latitude), Math.cos(latitude)];
  const prime_m = EQUATOR_M / Math.sqrt(1 - SQUARED_ECCENTRICITY * sin * sin);
  // From the axis through the anchor's meridian, eastward, and along the axis.
  const out_m = (prime_m + anchor.height_m + up) * cos - north * sin;
  const along_m = (prime_m * (1 - SQUARED_ECCENTRICITY) + anchor.height_m + up) * sin + north * cos;
  const axis_m = Math.hypot(out_m, east);
  let found = latitude;
  for (let k = 0; k < 4; k++) {
    const here_m = EQUATOR_M / Math.sqrt(1 - SQUARED_ECCENTRICITY * Math.sin(found) ** 2);
    found = Math.atan2(along_m + SQUARED_ECCENTRICITY * here_m * Math.sin(found), axis_m);
  }
  const sine = Math.sin(found);
  const height_m = axis_m * Math.cos(found) + along_m * sine - EQUATOR_M * Math.sqrt(1 - SQUARED_ECCENTRICITY * sine * sine);
  return [found / DEGREE, anchor.longitude_deg + Math.atan2(east, out_m) / DEGREE, height_m];
}

/** Web Mercator: x from the date line eastward, y from the north, both in [0, 1] of the whole square. */
export function mercator(latitude_deg: number, longitude_deg: number): [x: number, y: number] {
  const y = Math.log(Math.tan(Math.PI / 4 + (latitude_deg * DEGREE) / 2));
  return [longitude_deg / 360 + 0.5, 0.5 - y / (2 * Math.PI)];
}
