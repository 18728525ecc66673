// What the browser draws in 3D with, and what that can take.

export interface Renderer {
  /** Vertices along the longer side of the ground: of what still turns smoothly. */
  vertices: number;
  /** Samples a pixel of the ground, at most, where it is looked at from the side. */
  anisotropy: number;
  /** Whether edges are smooth. */
  antialias: boolean;
}

const CARD: Renderer = { vertices: 300, anisotropy: 8, antialias: true };
/** As without a graphics card, on a virtual machine or a remote desktop: as for a card a frame of the demo took .9 s. */
const PROCESSOR: Renderer = { vertices: 150, anisotropy: 2, antialias: false };
const IS_PROCESSOR = /swiftshader|llvmpipe|softpipe|software|basic render/i;

/** By what it calls itself. */
export function rendererOf(name: string): Renderer {
  return IS_PROCESSOR.test(name) ? PROCESSOR : CARD;
}

/** null where the browser draws in 3D not at all, now: without a graphics card some do not, others not after a crash. */
export function renderer(): Renderer | null {
  const context = document.createElement("canvas").getContext("webgl2");
  if (!context) return null;
  const plain = String(context.getParameter(context.RENDERER));
  // Chromium and Safari hide it there, and Firefox warns who asks for it otherwise.
  const told = plain === "WebKit WebGL" ? context.getExtension("WEBGL_debug_renderer_info") : null;
  const name = told ? String(context.getParameter(told.UNMASKED_RENDERER_WEBGL)) : plain;
  context.getExtension("WEBGL_lose_context")?.loseContext(); // browsers have a few at most
  return rendererOf(name);
}
