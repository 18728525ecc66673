import { describe, expect, it } from "vitest";
import { rendererOf } from "../src/map/renderer";

describe("what the map is drawn with", () => {
  it.each([
    "ANGLE (Google, Vulkan 1.3.0 (SwiftShader Device (Subzero) (0x0000C0DE)), SwiftShader driver)",
    "llvmpipe, or similar",
    "Mesa/X.org, llvmpipe (LLVM 15.0.6, 256 bits)",
    "ANGLE (Microsoft, Microsoft Basic Render Driver Direct3D11 vs_5_0 ps_5_0, D3D11)",
    "Apple Software Renderer",
  ])("is the processor: %s", (name) => {
    expect(rendererOf(name)).toEqual({ vertices: 150, anisotropy: 2, antialias: false });
  });

  it.each([
    "ANGLE (Intel, Mesa Intel(R) UHD Graphics 620 (KBL GT2), OpenGL 4.6)",
    "ANGLE (NVIDIA, NVIDIA GeForce GTX 980 Direct3D11 vs_5_0 ps_5_0), or similar",
    "Apple GPU",
    "Mali-G78",
    "WebKit WebGL",
  ])("is a card, or nobody says: %s", (name) => {
    expect(rendererOf(name)).toEqual({ vertices: 300, anisotropy: 8, antialias: true });
  });
});
