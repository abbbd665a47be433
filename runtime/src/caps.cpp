#include "caps.h"

namespace uvc {

namespace {

// Height of the caps, in radii of the opening: high enough that a cut knee keeps its shape.
constexpr float CAP_HEIGHT = 0.7f;

constexpr float PI = 3.14159265359f;

// Tip of the cap over a rim of edges (E, 2).
Vec tip_over(Array<int32_t> rim, const Vec *vertices) {
    int edges = rim.size / 2;
    Vec centre{}, area{};
    for (int k = 0; k < edges; k++) centre += vertices[rim[2 * k + 1]];
    centre = (1.0f / (float)edges) * centre;
    for (int k = 0; k < edges; k++)
        area += 0.5f * cross(vertices[rim[2 * k + 1]] - centre, vertices[rim[2 * k]] - centre);
    float size = length(area);
    return centre + (CAP_HEIGHT * root(size / PI) / most(size, 1e-9f)) * area;
}

}  // namespace

Caps read_caps(const Sections &sections, int vertices, Arena &arena, Failure &failure) {
    Caps caps;
    caps.tips = read_indices(sections, "caps.tips", -1, 1, 0, vertices, arena, failure);
    caps.rims = read_indices(sections, "caps.rims", -1, 2, 0, vertices, arena, failure);
    int edges = caps.rims.size / 2;
    caps.rim_starts = read_starts(sections, "caps.rim_starts", caps.tips.size, edges, arena, failure);
    for (int k = 0; k < caps.tips.size && !failure.failed; k++)
        if (caps.rim_starts[k] == caps.rim_starts[k + 1]) failure.say("cap %d has no rim", k);
    return failure.failed ? Caps{} : caps;
}

void add_tips(const Caps &caps, Vec *vertices) {
    for (int k = 0; k < caps.tips.size; k++) {
        Array<int32_t> rim = caps.rims.part(2 * caps.rim_starts[k], 2 * caps.rim_starts[k + 1]);
        vertices[caps.tips[k]] = tip_over(rim, vertices);
    }
}

}  // namespace uvc
