#version 330
#include "air.glsl"
#include "outputs.glsl"
in vec3 v_world;
in vec3 v_normal;
in vec3 v_colour;
in vec2 v_wall;
in float v_depth;

const float STOREY_M = 3.1, BAY_M = 2.7;

void main() {
    vec3 normal = normalize(v_normal);
    float along = dot(v_world.xy, vec2(-normal.y, normal.x));
    vec4 grain = texture(u_noise, vec2(along, v_world.z) / 3.7 + v_world.xy * 0.01);
    vec3 albedo = v_colour * (0.62 + 0.40 * grain.x);
    float glass = 0.0;
    if (v_wall.x > 0.5) {
        vec2 cell = vec2(along / BAY_M, v_wall.y / STOREY_M);
        vec2 at = fract(cell);
        bool shop = v_wall.y < STOREY_M;
        vec2 low = shop ? vec2(0.10, 0.06) : vec2(0.30, 0.30), high = shop ? vec2(0.90, 0.74) : vec2(0.70, 0.80);
        vec2 inside = step(low, at) * step(at, high);
        vec2 frame = step(low - 0.04, at) * step(at, high + 0.04);
        albedo = mix(albedo, vec3(0.55, 0.53, 0.5), frame.x * frame.y * 0.8);
        glass = inside.x * inside.y;
        float blind = fract(sin(dot(floor(cell), vec2(127.1, 311.7))) * 43758.5);
        albedo = mix(albedo, blind > 0.8 ? vec3(0.45, 0.42, 0.36) : vec3(0.03, 0.04, 0.05), glass);
        albedo *= 0.8 + 0.2 * smoothstep(0.0, 2.0, v_wall.y);
    } else if (normal.z > 0.25) {
        float tile = smoothstep(0.75, 0.95, fract(length(vec2(v_world.z * 3.2, 0.0)) + 0.2 * grain.y));
        albedo *= 0.85 + 0.25 * grain.z - 0.25 * tile * step(normal.z, 0.97);
    }
    float sun = sunlight(v_world + normal * 0.12) * cloud_shadow(v_world);
    vec3 colour = lit(albedo, normal, sun, normal.z < -0.3 ? 0.55 : 0.85);
    if (glass > 0.5) {
        vec3 mirrored = reflect(normalize(v_world - u_eye), normal);
        colour += 0.35 * mix(u_haze_colour, u_sky_colour, clamp(mirrored.z, 0.0, 1.0));
    }
    out_colour = vec4(tone_mapped(through_air(colour, v_world)), 1.0);
    out_label = uvec2(1u, 0u);
    out_depth = v_depth;
}
