#version 330
#include "projection.glsl"
in vec3 in_position;
in vec3 in_normal;
in vec4 in_cover_a;
in vec4 in_cover_b;
in vec3 in_road;   // margin, lateral, arc in metres
in vec2 in_light;  // sun reaches the ground (0-1), openness to the sky (0-1)
out vec3 v_world;
out vec3 v_normal;
out vec4 v_cover_a;
out vec4 v_cover_b;
out vec3 v_road;
out vec2 v_light;
out float v_depth;

void main() {
    v_world = in_position;
    v_normal = in_normal;
    v_cover_a = in_cover_a;
    v_cover_b = in_cover_b;
    v_road = in_road;
    v_light = in_light;
    gl_Position = clip_from_world(in_position);
    v_depth = gl_Position.w;
}
