// What the zones leave as: the formats of `crowdfence export`.

export interface Format {
  name: string;
  title: string;
  use: string;
  ending: string;
  /** Needs a place on Earth. */
  earth: boolean;
  /** Needs a country. */
  country?: true;
}

export const FORMATS: readonly Format[] = [
  { name: "geojson", title: "GeoJSON", use: "any GIS, with the evidence", ending: "geojson", earth: false },
  { name: "ed318", title: "ED-318", use: "UAS zones for U-space, 2023", ending: "json", earth: true, country: true },
  { name: "ed269", title: "ED-269", use: "UAS zones for geo-awareness", ending: "json", earth: true, country: true },
  { name: "f3548", title: "ASTM F3548", use: "constraints for UTM", ending: "json", earth: true },
  { name: "kml", title: "KML", use: "Google Earth, DJI Pilot", ending: "kml", earth: true },
  { name: "qgc", title: "QGroundControl plan", use: "a fence for PX4 and ArduPilot", ending: "plan", earth: true },
  { name: "csv", title: "CSV", use: "one row a zone", ending: "csv", earth: true },
];

/** The same from the command line, on the folder that a run wrote. */
export function exportCommand(format: string, { at, country }: { at: string | null; country: string | null }): string {
  const { ending } = FORMATS.find(({ name }) => name === format)!;
  const words = ["crowdfence", "export", "out/", "--format", format];
  if (at) words.push("--at", at);
  if (country) words.push("--country", country);
  return [...words, "-o", `zones.${ending}`].join(" ");
}
