// Sun, sky, haze, shadow and tone: shared by everything that is lit. Colours are linear until tone_mapped().
uniform vec3 u_sun_direction;
uniform vec3 u_sun_colour;
uniform vec3 u_sky_colour;
uniform vec3 u_haze_colour;
uniform float u_haze_per_m;
uniform float u_cloud_cover;
uniform float u_exposure;
uniform float u_time_s;
uniform vec3 u_eye;
uniform sampler2D u_noise;
uniform mat4 u_near_shadow_from_world;
uniform mat4 u_far_shadow_from_world;
uniform sampler2DShadow u_near_shadow;
uniform sampler2DShadow u_far_shadow;
uniform vec2 u_shadow_texel;  // near, far: one texel in texture coordinates

float shadow_taps(sampler2DShadow map, vec3 at, float texel) {
    float light = texture(map, at + vec3(-0.6, -0.4, 0.0) * texel);
    light += texture(map, at + vec3(0.7, -0.3, 0.0) * texel);
    light += texture(map, at + vec3(-0.1, 0.7, 0.0) * texel);
    return light / 3.0;
}

// 1 = in the sun. The near map holds what moves, the far map what stands still everywhere.
float sunlight(vec3 world) {
    vec3 near = (u_near_shadow_from_world * vec4(world, 1.0)).xyz;
    if (all(greaterThan(near.xy, vec2(0.01))) && all(lessThan(near.xy, vec2(0.99))))
        return shadow_taps(u_near_shadow, near, u_shadow_texel.x);
    vec3 far = (u_far_shadow_from_world * vec4(world, 1.0)).xyz;
    if (any(lessThan(far.xy, vec2(0.002))) || any(greaterThan(far.xy, vec2(0.998)))) return 1.0;
    return shadow_taps(u_far_shadow, far, u_shadow_texel.y);
}

float cloud_shadow(vec3 world) {
    vec2 drift = vec2(4.0, 1.5) * u_time_s;
    float density = texture(u_noise, (world.xy + drift) / 1100.0).x;
    float low = 0.78 - 0.30 * u_cloud_cover;
    return 1.0 - 0.5 * smoothstep(low, low + 0.12, density);
}

vec3 lit(vec3 albedo, vec3 normal, float sun, float openness) {
    vec3 bounce = vec3(0.20, 0.18, 0.14) * u_sky_colour.b;
    vec3 ambient = mix(bounce, u_sky_colour, 0.5 + 0.5 * normal.z) * openness;
    return albedo * (u_sun_colour * max(dot(normal, u_sun_direction), 0.0) * sun + ambient);
}

vec3 through_air(vec3 colour, vec3 world) {
    vec3 ray = world - u_eye;
    float distance_m = length(ray);
    float share = 1.0 - exp(-distance_m * u_haze_per_m);
    float towards_sun = max(dot(ray / distance_m, u_sun_direction), 0.0);
    return mix(colour, u_haze_colour + 0.12 * u_sun_colour * pow(towards_sun, 6.0), share);
}

// Filmic curve after Narkowicz (2015), then the sRGB power law.
vec3 tone_mapped(vec3 colour) {
    vec3 c = colour * u_exposure;
    c = c * (2.51 * c + 0.03) / (c * (2.43 * c + 0.59) + 0.14);
    return pow(clamp(c, 0.0, 1.0), vec3(1.0 / 2.2));
}
