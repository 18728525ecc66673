#version 330
#include "projection.glsl"
in vec3 in_position;
in vec3 in_normal;
in vec3 in_colour;
in vec2 in_wall;  // 1 = wall with windows, 0 = roof; height above the building's foot
out vec3 v_world;
out vec3 v_normal;
out vec3 v_colour;
out vec2 v_wall;
out float v_depth;

void main() {
    v_world = in_position;
    v_normal = in_normal;
    v_colour = pow(in_colour, vec3(2.2));
    v_wall = in_wall;
    gl_Position = clip_from_world(in_position);
    v_depth = gl_Position.w;
}
