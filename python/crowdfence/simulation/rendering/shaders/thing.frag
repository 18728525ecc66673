#version 330
#include "air.glsl"
#include "outputs.glsl"
in vec3 v_world;
in vec3 v_normal;
in vec3 v_colour;
in vec3 v_local;
in float v_depth;
flat in uvec2 v_label;
flat in float v_seed;
in float v_own;
uniform int u_material;  // 0 plain, 1 foliage, 2 stone, 3 clothed figure
uniform float u_snow;    // 0-1: how white upward faces are

void main() {
    vec3 normal = normalize(v_normal);
    vec3 albedo = v_colour;
    float openness = 1.0, gloss = 0.0;
    if (u_material == 1 && v_own < 0.5) {
        vec4 clump = texture(u_noise, (v_local.xy + v_local.z * vec2(1.3, 0.7)) / 2.9 + v_seed);
        vec4 leaf = texture(u_noise, (v_local.yz + v_local.x * vec2(0.6, 1.1)) / 0.85);
        // Gaps between leaves; in winter few are left.
        // Two noises across each other, so that the gaps are not drawn out along any side of the crown.
        float cover = leaf.w + texture(u_noise, (v_local.xz - v_local.y * vec2(0.8, 0.5)) / 0.7 + 0.3).y;
        if (cover < 0.86 + 0.14 * u_snow && v_depth < 140.0) discard;
        albedo *= 0.42 + 1.15 * clump.x * (0.35 + leaf.y);
        normal = normalize(normal + 1.1 * (vec3(leaf.xz, clump.y) - 0.5) + vec3(0.0, 0.0, 0.2));
        openness = 0.72 + 0.28 * normal.z;
    } else {
        if (!gl_FrontFacing) normal = -normal;
        vec4 grain = texture(u_noise, vec2(v_local.x * 1.3 + v_seed * 7.0, v_local.z * 0.9 + v_local.y));
        if (u_material == 2) {
            albedo *= 0.55 + 0.9 * grain.x;
            normal = normalize(normal + 0.9 * (grain.yzw - 0.5));
        } else if (u_material == 3) {
            albedo *= 0.84 + 0.32 * grain.x;
            // One in four wears stripes.
            if (v_seed < 0.25 && v_local.z > 1.0 && v_local.z < 1.42 && fract(v_local.z * 9.0) < 0.4) albedo *= 0.55;
            openness = 0.62 + 0.38 * clamp(v_local.z, 0.0, 1.0);
        } else {
            albedo *= 0.92 + 0.16 * grain.x;
            gloss = 0.05;
        }
    }
    // People shake it off.
    float snow = u_material == 3 ? 0.0 : u_snow * smoothstep(0.25, 0.6, normal.z);
    albedo = mix(albedo, vec3(0.82, 0.85, 0.90), u_material == 1 ? 0.6 * snow : snow);
    float sun = sunlight(v_world + normal * 0.06) * cloud_shadow(v_world);
    vec3 colour = lit(albedo, normal, sun, openness);
    if (gloss > 0.0) {
        vec3 mirrored = reflect(normalize(v_world - u_eye), normal);
        colour += gloss * sun * u_sun_colour * pow(max(dot(mirrored, u_sun_direction), 0.0), 14.0);
        colour += 0.05 * u_sky_colour * clamp(mirrored.z, 0.0, 1.0);
    }
    out_colour = vec4(tone_mapped(through_air(colour, v_world)), 1.0);
    out_label = v_label;
    out_depth = v_depth;
}
