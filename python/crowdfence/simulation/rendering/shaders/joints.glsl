// Moves the limbs of people and cyclists. Limb numbers: meshes/shape.py `Limb`; cyclist joints: meshes/cycles.py.
// Rotations are about the y axis (left); a positive angle swings the lower end forward (+x).

void swing(inout vec3 point, inout vec3 normal, vec2 joint, float angle) {
    float c = cos(angle), s = sin(angle);
    vec2 arm = point.xz - joint;
    point.xz = joint + vec2(c * arm.x - s * arm.y, s * arm.x + c * arm.y);
    normal.xz = vec2(c * normal.x - s * normal.z, s * normal.x + c * normal.z);
}

// Outwards about the x axis (forward); side 1 = left.
void spread(inout vec3 point, inout vec3 normal, vec2 joint, float side, float angle) {
    float c = cos(angle), s = side * sin(angle);
    vec2 arm = point.yz - joint;
    point.yz = joint + vec2(c * arm.x - s * arm.y, s * arm.x + c * arm.y);
    normal.yz = vec2(c * normal.y - s * normal.z, s * normal.y + c * normal.z);
}

// pose: phase of the gait, stride (0-1), arms raised (0-1), which arms (1 = left, 2 = right, 3 = both).
// stance: how far legs point sideways [rad].
void pose_person(inout vec3 point, inout vec3 normal, int limb, vec4 pose, float stance) {
    bool lower = limb > 5;
    int upper = lower ? limb - 5 : limb;
    float side = (upper == 1 || upper == 3) ? 1.0 : -1.0;
    float swinging = side * sin(pose.x) * pose.y;
    if (upper == 1 || upper == 2) {
        float knee = max(0.0, side * cos(pose.x)) * pose.y * 1.5 + 0.05;
        if (lower) swing(point, normal, vec2(0.0, 0.48), -knee);
        swing(point, normal, vec2(0.0, 0.92), swinging);
        spread(point, normal, vec2(side * 0.088, 0.92), side, stance);
    } else {
        bool raised = (int(pose.w + 0.5) & (upper == 3 ? 1 : 2)) != 0;
        float lift = raised ? pose.z * (2.5 + 0.3 * sin(2.3 * pose.x + side)) : 0.0;
        if (lower) swing(point, normal, vec2(0.0, 1.14), 0.25 + 0.5 * pose.y + 0.4 * lift / 2.5);
        swing(point, normal, vec2(0.0, 1.42), lift - 0.9 * swinging);
        // An arm above the shoulder goes outwards by turning the other way.
        if (raised) spread(point, normal, vec2(side * 0.205, 1.42), side, -2.0 * stance * pose.z);
    }
}

// Two-bone chain from the hip to the pedal.
void pose_cyclist(inout vec3 point, inout vec3 normal, int limb, float pedal_phase) {
    const vec2 hip = vec2(-0.16, 0.98), bracket = vec2(0.0, 0.28);
    const float thigh = 0.43, shin = 0.44, crank = 0.17;
    if (limb == 11) {
        swing(point, normal, bracket, -pedal_phase);
        return;
    }
    float turn = pedal_phase + ((limb == 1 || limb == 6) ? 0.0 : 3.14159265);
    vec2 pedal = bracket + crank * vec2(-sin(turn), -cos(turn));
    vec2 reach = pedal + vec2(-0.06, 0.09) - hip;
    float span = min(length(reach), thigh + shin - 0.005);
    float bend = acos(clamp((thigh * thigh + span * span - shin * shin) / (2.0 * thigh * span), -1.0, 1.0));
    float thigh_angle = atan(reach.x, -reach.y) + bend;
    if (limb == 1 || limb == 2) {
        swing(point, normal, hip, thigh_angle);
        return;
    }
    vec2 knee = hip + thigh * vec2(sin(thigh_angle), -cos(thigh_angle));
    vec2 ankle = hip + reach * (span / length(reach));
    vec2 along = ankle - knee;
    swing(point, normal, hip - vec2(0.0, thigh), atan(along.x, -along.y));
    point.xz += knee - (hip - vec2(0.0, thigh));
}

void flutter(inout vec3 point, inout vec3 normal, float time_s, float phase) {
    float wave = 5.0 * point.x - 7.0 * time_s + phase;
    point.y += 0.16 * point.x * sin(wave);
    point.z -= 0.05 * point.x * point.x;
    normal = normalize(vec3(-0.8 * point.x * cos(wave), 1.0, 0.1));
}
