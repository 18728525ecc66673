#version 330
// From the sample lattice to the image: one label and depth per pixel, exactly where the pixel's centre ray
// goes; colour filtered, blurred by the motion of the camera and grained like a sensor's.
layout(location = 0) out vec4 out_colour;
layout(location = 1) out uvec2 out_label;
layout(location = 2) out float out_depth;
uniform sampler2D u_colour;
uniform usampler2D u_label;
uniform sampler2D u_depth;
uniform sampler2D u_sample;      // per pixel: where its centre lies on the lattice, in samples
uniform int u_samples_per_pixel; // along each axis
uniform bool u_distorted;
uniform mat4 u_later_from_now;   // lattice position of a sample when the exposure ends: see motion()
uniform vec4 u_pinhole;          // fx, fy, cx, cy of the lattice
uniform bool u_blurred;
uniform float u_noise_sigma;     // standard deviation at mid grey, of 1
uniform uint u_seed;

const int BLUR_STEPS = 7;

uint scrambled(uint x) {  // PCG hash (Jarzynski and Olano 2020)
    x = x * 747796405u + 2891336453u;
    x = ((x >> ((x >> 28u) + 4u)) ^ x) * 277803737u;
    return (x >> 22u) ^ x;
}

float bell(inout uint state) {  // sum of four uniforms: mean 0, variance 1
    float total = 0.0;
    for (int k = 0; k < 4; ++k) {
        state = scrambled(state);
        total += float(state >> 8u) / 16777216.0;
    }
    return (total - 2.0) * 1.7320508;
}

// The same filters as filtered() for a position in the middle of a sample, without interpolation: cheaper.
vec3 filtered_at_sample(ivec2 at) {
    vec3 centre = texelFetch(u_colour, at, 0).rgb;
    if (u_samples_per_pixel == 1) return centre;
    vec3 sides = texelFetch(u_colour, at + ivec2(1, 0), 0).rgb + texelFetch(u_colour, at - ivec2(1, 0), 0).rgb
               + texelFetch(u_colour, at + ivec2(0, 1), 0).rgb + texelFetch(u_colour, at - ivec2(0, 1), 0).rgb;
    vec3 corners = texelFetch(u_colour, at + ivec2(1, 1), 0).rgb + texelFetch(u_colour, at - ivec2(1, 1), 0).rgb
                 + texelFetch(u_colour, at + ivec2(1, -1), 0).rgb + texelFetch(u_colour, at - ivec2(1, -1), 0).rgb;
    if (u_samples_per_pixel == 2) return (4.0 * centre + 2.0 * sides + corners) / 16.0;
    return (centre + sides + corners) / 9.0;
}

vec3 filtered(vec2 at) {
    if (u_samples_per_pixel == 1) return texture(u_colour, at / vec2(textureSize(u_colour, 0))).rgb;
    vec2 size = vec2(textureSize(u_colour, 0));
    if (u_samples_per_pixel == 2) {  // 1 2 1 by four bilinear taps: a tent centred on the pixel
        vec2 h = vec2(0.5, -0.5);
        return 0.25 * (texture(u_colour, (at + h.xx) / size).rgb + texture(u_colour, (at + h.xy) / size).rgb
                     + texture(u_colour, (at + h.yx) / size).rgb + texture(u_colour, (at + h.yy) / size).rgb);
    }
    vec3 total = vec3(0.0);
    for (int j = -1; j <= 1; ++j)
        for (int i = -1; i <= 1; ++i) total += texture(u_colour, (at + vec2(i, j)) / size).rgb;
    return total / 9.0;
}

vec2 motion(vec2 at, float depth) {
    vec3 now = vec3((at - u_pinhole.zw) / u_pinhole.xy, 1.0) * min(depth, 1.0e5);
    vec3 later = (u_later_from_now * vec4(now, 1.0)).xyz;
    if (later.z < 0.1) return vec2(0.0);
    return u_pinhole.zw + u_pinhole.xy * later.xy / later.z - at;
}

// Change of 1 / depth along one axis per sample, from the neighbour on the side of `towards` or else the other;
// 0 where neither shows the same surface.
float inverse_slope(ivec2 at, ivec2 axis, float towards, uvec2 label, float depth) {
    int side = towards < 0.0 ? -1 : 1;
    for (int attempt = 0; attempt < 2; ++attempt) {
        ivec2 tap = at + side * axis;
        float other = texelFetch(u_depth, tap, 0).x;
        if (texelFetch(u_label, tap, 0).xy == label && max(other, depth) < 1.1 * min(other, depth))
            return (1.0 / other - 1.0 / depth) * float(side);
        side = -side;
    }
    return 0.0;
}

// 1 / depth is linear across a plane in the image, so near a sample of the plane its slope gives the depth exactly.
float depth_between(vec2 at, ivec2 nearest, uvec2 label) {
    float depth = texelFetch(u_depth, nearest, 0).x;
    vec2 offset = at - vec2(nearest) - 0.5;
    float inverse = 1.0 / depth;
    inverse += offset.x * inverse_slope(nearest, ivec2(1, 0), offset.x, label, depth);
    inverse += offset.y * inverse_slope(nearest, ivec2(0, 1), offset.y, label, depth);
    return 1.0 / inverse;
}

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec2 at = texelFetch(u_sample, pixel, 0).xy;
    ivec2 nearest = ivec2(floor(at));
    out_label = texelFetch(u_label, nearest, 0).xy;
    out_depth = u_distorted ? depth_between(at, nearest, out_label) : texelFetch(u_depth, nearest, 0).x;
    vec3 colour = u_distorted ? filtered(at) : filtered_at_sample(nearest);
    if (u_blurred) {
        vec2 path = motion(at, texelFetch(u_depth, nearest, 0).x);
        for (int k = 1; k < BLUR_STEPS; ++k)
            colour += filtered(at + path * (float(k) / float(BLUR_STEPS - 1) - 0.5));
        colour /= float(BLUR_STEPS);
    }
    if (u_noise_sigma > 0.0) {
        uint state = scrambled(uint(pixel.x) + scrambled(uint(pixel.y) + scrambled(u_seed)));
        float grey = dot(colour, vec3(0.299, 0.587, 0.114));
        vec3 grain = vec3(bell(state), bell(state), bell(state));
        colour += u_noise_sigma * (0.55 + 0.9 * sqrt(max(grey, 0.0))) * mix(vec3(grain.g), grain, 0.55);
    }
    out_colour = vec4(clamp(colour, 0.0, 1.0), 1.0);
}
