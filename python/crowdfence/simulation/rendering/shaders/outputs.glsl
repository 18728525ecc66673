// What every visible fragment writes: colour, (class, instance) and distance along the optical axis in metres.
layout(location = 0) out vec4 out_colour;
layout(location = 1) out uvec2 out_label;
layout(location = 2) out float out_depth;
