#version 330
#include "projection.glsl"
#include "thing.glsl"
in vec2 in_label;  // class, instance
out vec3 v_world;
out vec3 v_normal;
out vec3 v_colour;
out vec3 v_local;
out float v_depth;
flat out uvec2 v_label;
flat out float v_seed;
out float v_own;  // 1 = the mesh's own colour (bark), 0 = the instance's (leaves)

void main() {
    Placed here = placed();
    v_world = here.world;
    v_normal = here.normal;
    v_local = here.local;
    v_colour = instance_colour();
    v_label = uvec2(in_label + 0.5);
    v_seed = in_turn.w;
    v_own = step(0.9, in_colour.w);
    gl_Position = clip_from_world(here.world);
    v_depth = gl_Position.w;
}
