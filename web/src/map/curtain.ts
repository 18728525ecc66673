// Zones as walls of light on the ground: how high they really reach is in the inspector, not in the picture.

import type { Outline } from "../api/contract";
import { draped } from "./geometry";
import type { Heights } from "./heights";
import { mesh, type Mesh } from "./terrain_mesh";

export function curtainMesh(outlines: readonly Outline[], heights: Heights, tall_m: number): Mesh | null {
  const positions: number[] = [];
  const texCoords: number[] = [];
  const indices: number[] = [];
  for (const ring of outlines.flat(2)) {
    const first = positions.length / 3;
    const line = draped(ring, heights, 0);
    line.forEach(([east, north, up], k) => {
      positions.push(east, north, up, east, north, up + tall_m);
      texCoords.push(0.5, 1, 0.5, 0);
      if (k + 1 < line.length) {
        const a = first + 2 * k;
        indices.push(a, a + 1, a + 2, a + 2, a + 1, a + 3);
      }
    });
  }
  return indices.length ? mesh(positions, texCoords, indices) : null;
}
