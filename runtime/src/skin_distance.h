// Signed distances of points to the skin of a body that moves, from frame to frame.
#pragma once

#include "lane_tree.h"
#include "surface.h"

namespace uvc {

// The whole skin of a body.
struct WholeSkin {
    Surface surface;
    LaneTree tree;
};

// Faces have corners among the vertices at rest, m.
WholeSkin make_whole_skin(Array<Vec> rest, Array<Face> faces, Arena &arena);

// Distance of a point from the skin, m, negative inside, and the unit direction in which it grows; the reach
// and nothing where no skin is within reach.
struct NearSkin {
    float away;
    Vec outward;
};

// The skin in a frame, with vertices (V), m.
class SkinSearch {
  public:
    SkinSearch(const WholeSkin &skin, const Vec *vertices, Arena &work);

    // Finds the skin near points (U), m. faces: (U) the closest face of each in the frame before, -1 for none;
    // set to those of now. All faces are searched in the first frame, and then for one point of eight in each;
    // the others are followed over neighbouring faces.
    void find_near(const Vec *points, int count, int frame, float reach, int32_t *faces, NearSkin *near);

  private:
    const WholeSkin &skin_;
    const Vec *vertices_;
    FittedTree fitted_;
};

}  // namespace uvc
