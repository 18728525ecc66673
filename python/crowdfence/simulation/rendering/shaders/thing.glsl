// An instance of a mesh: placed, posed and coloured. Shared by the picture and the shadow pass.
#include "joints.glsl"
in vec3 in_position;
in vec3 in_normal;
in vec4 in_colour;      // sRGB factor; w * 255 = colour slot 0-5, or 255
in float in_limb;      // limb number / 255
in vec4 in_place;      // position, scale
in vec4 in_turn;       // heading; slope along x and y of the ground, or pitch, or girth and stance; seed 0-1
in vec4 in_pose;       // people: see pose_person; cyclists: pedal phase in x
in vec4 in_colours_a;   // packed below as 8-bit triples in floats
in vec2 in_colours_b;
uniform int u_motion;  // 0 still, 1 person, 2 cyclist, 3 cloth
uniform float u_time_s;

struct Placed { vec3 world; vec3 normal; vec3 local; };

Placed placed() {
    vec3 point = in_position, normal = in_normal;
    int limb = int(in_limb * 255.0 + 0.5);
    if (limb > 0) {
        if (u_motion == 1) pose_person(point, normal, limb, in_pose, in_turn.z);
        else if (u_motion == 2) pose_cyclist(point, normal, limb, in_pose.x);
        else if (u_motion == 3) flutter(point, normal, u_time_s, 40.0 * in_turn.w);
    }
    Placed result;
    if (u_motion == 1) point.xy *= in_turn.y;
    result.local = point;
    point *= in_place.w;
    if (u_motion == 2) swing(point, normal, vec2(0.0), in_turn.y);
    float c = cos(in_turn.x), s = sin(in_turn.x);
    point.xy = vec2(c * point.x - s * point.y, s * point.x + c * point.y);
    normal.xy = vec2(c * normal.x - s * normal.y, s * normal.x + c * normal.y);
    // Things stand on sloping ground: shear them with it.
    if (u_motion == 0 || u_motion == 3) point.z += dot(in_turn.yz, point.xy);
    result.world = point + in_place.xyz;
    result.normal = normal;
    return result;
}

vec3 slot_colour(float packed_rgb) {
    vec3 rgb = vec3(mod(packed_rgb, 256.0), mod(floor(packed_rgb / 256.0), 256.0), floor(packed_rgb / 65536.0));
    return rgb / 255.0;
}

vec3 instance_colour() {
    int slot = int(in_colour.w * 255.0 + 0.5);
    vec3 own = in_colour.rgb;
    if (slot < 4) own *= slot_colour(in_colours_a[slot]);
    else if (slot < 6) own *= slot_colour(in_colours_b[slot - 4]);
    return pow(own, vec3(2.2));
}
