#version 330
in vec3 in_position;
uniform mat4 u_shadow_clip_from_world;
void main() { gl_Position = u_shadow_clip_from_world * vec4(in_position, 1.0); }
