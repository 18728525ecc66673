// World -> clip space. With a rolling exposure each row has its own pose: start and end are blended by the row.
uniform mat4 u_clip_from_world[2];
uniform bool u_rolling;

vec4 clip_from_world(vec3 world) {
    vec4 first = u_clip_from_world[0] * vec4(world, 1.0);
    if (!u_rolling) return first;
    vec4 last = u_clip_from_world[1] * vec4(world, 1.0);
    vec4 clip = mix(first, last, 0.5);
    for (int pass = 0; pass < 2; ++pass) {
        // Row 0 is the top row and lies at y = -1.
        float row = clip.w > 0.1 ? clamp(0.5 + 0.5 * clip.y / clip.w, -0.1, 1.1) : 0.5;
        clip = mix(first, last, row);
    }
    return clip;
}
