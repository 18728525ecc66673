#version 330
#include "air.glsl"
#include "outputs.glsl"
in vec3 v_world;
in vec3 v_normal;
in vec4 v_cover_a;  // grass, dirt, rock, snow
in vec4 v_cover_b;  // sand, paving, water, gravel
in vec3 v_road;
in vec2 v_light;
in float v_depth;
uniform vec3 u_cover_colour[16];  // dark and light tone of each cover
uniform float u_road_half_width_m;
uniform bool u_road_marked;

vec3 tone_of(int cover, float t) { return mix(u_cover_colour[2 * cover], u_cover_colour[2 * cover + 1], t); }

vec3 natural_ground(vec4 broad, vec4 mid, vec4 fine) {
    float grain = 0.45 * mid.y + 0.55 * fine.z;
    // Weights times noise, sharpened: ragged borders between covers in place of a blur.
    vec4 a = v_cover_a * (0.55 + vec4(broad.x, mid.z, broad.w, mid.w));
    vec4 b = v_cover_b * (0.55 + vec4(mid.y, 0.5, 0.5, fine.x));
    a *= a; a *= a;
    b *= b; b *= b;
    vec3 colour = a.x * tone_of(0, smoothstep(0.32, 0.68, 0.55 * broad.y + 0.45 * mid.x)) * (0.55 + 0.9 * grain);
    colour += a.y * tone_of(1, mid.x) * (0.60 + 0.8 * fine.x);
    colour += a.z * tone_of(2, mid.w) * (0.45 + 1.1 * fine.y * (0.5 + mid.x));
    colour += a.w * tone_of(3, mid.x) * (0.88 + 0.24 * fine.w);
    // Sand is dark where waves have wetted it.
    float wet = smoothstep(0.0, 0.5, v_cover_b.z);
    colour += b.x * tone_of(4, 0.6 * broad.z + 0.4 * fine.y) * (0.84 + 0.32 * fine.z) * (1.0 - 0.45 * wet);
    colour += b.w * tone_of(7, fine.w) * (0.50 + 1.0 * fine.y * (0.4 + mid.x));
    return colour / (dot(a, vec4(1.0)) + b.x + b.w + 1e-4);
}

vec3 paved(vec4 mid, vec4 fine) {
    vec2 slab = v_world.xy / 0.6;
    vec2 joint = abs(fract(slab) - 0.5);
    float line = smoothstep(0.44, 0.49, max(joint.x, joint.y)) * smoothstep(90.0, 25.0, v_depth);
    float tint = fract(sin(dot(floor(slab), vec2(12.99, 78.23))) * 437.6);
    return tone_of(5, mid.x) * (0.80 + 0.22 * tint + 0.25 * (fine.x - 0.5)) * (1.0 - 0.35 * line);
}

vec3 asphalt(vec4 broad, vec4 mid, vec4 fine) {
    float across = abs(v_road.y);
    vec3 colour = vec3(0.085, 0.087, 0.092) * (0.72 + 0.35 * fine.x + 0.35 * broad.x);
    colour *= 1.0 - 0.35 * smoothstep(0.03, 0.0, abs(mid.x - 0.5) * abs(mid.y - 0.42) * 4.0);  // cracks
    colour *= 1.0 - 0.22 * smoothstep(0.55, 0.0, abs(across - 0.5 * u_road_half_width_m));     // wheel tracks
    if (u_road_marked) {
        float wear = 0.5 + 0.5 * smoothstep(0.3, 0.62, 0.6 * fine.w + 0.4 * mid.w);
        bool edge = abs(across - (u_road_half_width_m - 0.28)) < 0.07;
        bool middle = across < 0.07 && fract(v_road.z / 9.0) < 0.45;
        if (edge || middle) colour = mix(colour, vec3(0.62, 0.61, 0.57), wear);
        // Names that fans paint on a climb.
        float sheet = floor(v_road.z / 57.0);
        bool painted = fract(v_road.z / 57.0) < 0.09 && across < 2.3 && fract(sin(sheet * 12.9) * 437.0) > 0.4;
        if (painted && texture(u_noise, v_road.yz / 11.0 + sheet * 0.31).z > 0.56)
            colour = mix(colour, vec3(0.62, 0.60, 0.50), 0.75 * wear);
    }
    return colour;
}

vec3 sea(vec4 mid, vec4 fine, out vec3 normal) {
    vec4 swell = texture(u_noise, v_world.xy / 23.0 + vec2(0.013, 0.021) * u_time_s);
    vec4 ripple = texture(u_noise, v_world.yx / 5.1 - vec2(0.05, 0.03) * u_time_s);
    float calm = 1.0 / (1.0 + v_depth / 90.0);
    normal = normalize(vec3((swell.xy - 0.5) * 0.45 * calm + (ripple.xy - 0.5) * 0.4 * calm, 1.0));
    vec3 ray = normalize(v_world - u_eye);
    vec3 mirrored = reflect(ray, normal);
    float fresnel = 0.03 + 0.97 * pow(1.0 - max(-dot(ray, normal), 0.0), 5.0);
    float deep = smoothstep(0.0, 1.0, 1.0 - v_light.y);
    vec3 body = mix(u_cover_colour[13], u_cover_colour[12], deep) * (u_sky_colour + 0.35 * u_sun_colour);
    vec3 sky = mix(u_haze_colour, u_sky_colour, clamp(mirrored.z * 1.6, 0.0, 1.0));
    vec3 colour = mix(body, sky, fresnel) + 0.5 * u_sun_colour * pow(max(dot(mirrored, u_sun_direction), 0.0), 90.0);
    float wash = v_light.y + 0.05 * sin(0.7 * u_time_s + 6.0 * swell.z) + 0.12 * (ripple.z - 0.5);
    float foam = smoothstep(0.88, 0.97, wash) * smoothstep(0.42, 0.68, ripple.w + 0.2 * (swell.x - 0.5));
    float crest = smoothstep(0.035, 0.0, abs(fract(wash * 3.0 - 0.04 * u_time_s) - 0.5)) * smoothstep(0.45, 0.8, v_light.y);
    return mix(colour, 0.45 * u_sun_colour + 0.8 * u_sky_colour, clamp(0.8 * foam + 0.35 * crest * ripple.x, 0.0, 0.8));
}

void main() {
    vec4 broad = texture(u_noise, v_world.xy / 61.0);
    vec4 mid = texture(u_noise, v_world.xy / 7.3 + 0.08 * broad.zw);
    // Bent by the coarser noise, so that its tiling does not show.
    vec4 fine = texture(u_noise, v_world.xy / 1.3 + v_world.z * 0.07 + 0.55 * (mid.xz - 0.5));
    vec3 normal = normalize(v_normal);
    bool road = v_road.x < 0.0;
    vec3 colour;
    if (!road && v_cover_b.z > 0.5) {
        vec3 wave;
        colour = through_air(sea(mid, fine, wave), v_world);
    } else {
        vec3 albedo;
        if (road) albedo = asphalt(broad, mid, fine);
        else if (v_cover_b.y > 0.5) albedo = paved(mid, fine);
        else {
            albedo = natural_ground(broad, mid, fine);
            normal = normalize(normal + vec3((fine.xy - 0.5) * 0.5 + (mid.zw - 0.5) * 0.5, 0.0));
        }
        float sun = min(sunlight(v_world + normal * 0.05), v_light.x) * cloud_shadow(v_world);
        colour = through_air(lit(albedo, normal, sun, v_light.y), v_world);
    }
    out_colour = vec4(tone_mapped(colour), 1.0);
    out_label = uvec2(road ? 2u : 1u, 0u);
    out_depth = v_depth;
}
