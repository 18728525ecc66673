import { SimpleMeshLayer } from "@deck.gl/mesh-layers";

// Textures here hold what the eye should see, relief included. deck.gl's own shaders light a mesh pixel by pixel, with
// `material: false` too: colours on the map were darker than those of its legend, and without a graphics card that was
// three quarters of the time of a frame.
const VERTICES = `#version 300 es
#define SHADER_NAME unlit-mesh-layer-vs

in vec3 positions;
in vec2 texCoords;

in vec3 instancePositions;
in vec3 instancePositions64Low;
in vec4 instanceColors;

out vec2 vTexCoord;
out vec4 vColor;

void main(void) {
  vTexCoord = texCoords;
  vColor = instanceColors;
  gl_Position = project_position_to_clipspace(positions + instancePositions, instancePositions64Low, vec3(0.0));
}
`;

const PIXELS = `#version 300 es
#define SHADER_NAME unlit-mesh-layer-fs
precision highp float;

uniform sampler2D sampler;

in vec2 vTexCoord;
in vec4 vColor;

out vec4 fragColor;

void main(void) {
  vec4 color = simpleMesh.hasTexture ? texture(sampler, vTexCoord) : vColor;
  fragColor = vec4(color.rgb, color.a * layer.opacity);
}
`;

/** A mesh in metres, in the colours of its texture or in one colour, whatever the light. It cannot be pointed at. */
export class UnlitMeshLayer<T = unknown> extends SimpleMeshLayer<T> {
  static layerName = "UnlitMeshLayer";

  getShaders() {
    return { ...super.getShaders(), vs: VERTICES, fs: PIXELS };
  }
}
