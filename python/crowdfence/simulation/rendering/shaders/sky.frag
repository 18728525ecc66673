#version 330
#include "air.glsl"
#include "outputs.glsl"
in vec3 v_ray;

void main() {
    vec3 ray = normalize(v_ray);
    vec3 colour = mix(1.04 * u_haze_colour, u_sky_colour * vec3(0.50, 0.82, 1.20), pow(clamp(1.9 * ray.z, 0.0, 1.0), 0.5));
    float sunward = max(dot(ray, u_sun_direction), 0.0);
    if (ray.z > 0.015) {
        vec2 at = ray.xy / (ray.z + 0.14) + u_time_s * vec2(0.0012, 0.0005);
        float density = 0.55 * texture(u_noise, 0.055 * at).x + 0.30 * texture(u_noise, 0.16 * at).y
                      + 0.15 * texture(u_noise, 0.5 * at).z;
        float low = 0.60 - 0.26 * u_cloud_cover;
        float cloud = smoothstep(low, low + 0.17, density) * smoothstep(0.015, 0.16, ray.z);
        float thick = smoothstep(low + 0.08, low + 0.3, density);
        vec3 white = 0.42 * u_sun_colour * (1.0 - 0.5 * thick) + 0.75 * u_sky_colour;
        colour = mix(colour, white * (1.0 + 0.5 * pow(sunward, 8.0)), 0.9 * cloud);
    }
    colour += u_sun_colour * (3.0 * smoothstep(0.9995, 0.9999, sunward) + 0.22 * pow(sunward, 40.0));
    out_colour = vec4(tone_mapped(colour), 1.0);
    out_label = uvec2(0u);
    out_depth = 1.0e30;
}
