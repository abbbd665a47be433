// Points inside and outside of closed surfaces: signed distances, and what of several parts is nearest.
#pragma once

#include "lane_tree.h"

namespace uvc {

// Exits minus entries of a ray from a start, m: above 0 inside of a closed surface. A ray through an edge or a
// corner counts once. The tree has to be fitted in all its patches.
int count_crossings(const LaneTree &tree, const FittedTree &fitted, Vec start, Vec direction);

// Surface point closest to a point. distance: m, negative inside, the reach where nothing is closer. place: m.
// outward: unit direction in which the distance grows. face: -1 beyond the reach, where all but the distance
// and the place, which is the point, are 0.
struct SignedClosest {
    float distance;
    Vec place, outward;
    int face;
    Vec weights;
};

// Posed surfaces fold into themselves, where the nearest sheet may face either way. The ray away from it
// crosses few others and shows whether the point is inside; where sheet and ray disagree, as at the border of
// an open surface, the majority of three rays decides.
SignedClosest signed_closest(const LaneTree &tree, const FittedTree &fitted, Vec point, float reach);

// The part that a point is deepest in or nearest to. distance: m, signed. outward: unit, and offset: m, product
// of the closest point with it, both 0 where no part is within reach. room: m, between it and the nearest part
// that faces it, negative where they overlap; FARTHEST where there is none.
struct NearestPart {
    float distance;
    Vec outward;
    float offset, room;
};

// Metres: farther than anything that is searched.
constexpr float FARTHEST = 10.0f;

// Looks at the parts of which a bit is set in `touched`. Parts that the point is outside of, and farther from
// than `exact`, m, count as that far away. narrow: m, least room that need not be exact.
NearestPart nearest_part(Array<LaneTree> trees, Array<FittedTree> fitted, int touched, Vec point, float reach,
                         float exact, float narrow);

}  // namespace uvc
