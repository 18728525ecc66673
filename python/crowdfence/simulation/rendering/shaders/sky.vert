#version 330
in vec2 in_corner;
uniform mat4 u_world_from_clip[2];
uniform bool u_rolling;
out vec3 v_ray;

void main() {
    // Both ends of the exposure, blended by the row that this corner lies in.
    float row = u_rolling ? clamp(0.5 + 0.5 * in_corner.y, 0.0, 1.0) : 0.0;
    vec4 first = u_world_from_clip[0] * vec4(in_corner, 1.0, 1.0);
    vec4 last = u_world_from_clip[1] * vec4(in_corner, 1.0, 1.0);
    v_ray = mix(first.xyz, last.xyz, row);
    gl_Position = vec4(in_corner, 0.9999999, 1.0);
}
