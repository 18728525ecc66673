#version 330
#include "thing.glsl"
uniform mat4 u_shadow_clip_from_world;
void main() { gl_Position = u_shadow_clip_from_world * vec4(placed().world, 1.0); }
