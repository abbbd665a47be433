// Edges of cloth that run through its faces.
#pragma once

#include "lane_tree.h"

namespace uvc {

// Whether the edge between two points, m, runs through a face that has a corner at neither of them. The tree
// has to be fitted in all its patches.
bool is_crossing(const LaneTree &tree, const FittedTree &fitted, Vec start, Vec end);

}  // namespace uvc
