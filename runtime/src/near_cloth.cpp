#include "near_cloth.h"

#include "lanes.h"

namespace uvc {

namespace {

// Metres between facing cloth at which it counts as lying on itself.
constexpr float CLOSED = 0.012f;

// Cosines between the normals of facing cloth, from which on it counts, and counts fully.
constexpr float BEGINS_TO_FACE = 0.3f, FACES = -0.1f;

// Cells of a grid at most, for each point.
constexpr int MOST_CELLS = 8;

// Points of cloth sorted by the cells of a grid around them, row by row. Their places, those at rest and their
// garments can be loaded in lanes.
class Grid {
  public:
    // A ball of the reach meets two cells along each axis.
    Grid(const Cloth &cloth, const Vec *points, Arena &work) : low_{FAR, FAR, FAR}, cell_(2 * BESIDE_REACH) {
        Vec high = -low_;
        int count = cloth.rest.size;
        for (int k = 0; k < count; k++) {
            Vec p = points[k];
            low_ = {least(low_.x, p.x), least(low_.y, p.y), least(low_.z, p.z)};
            high = {most(high.x, p.x), most(high.y, p.y), most(high.z, p.z)};
        }
        auto cells = [&](float low, float high) { return most(0.0f, least(FAR, high - low)) / cell_ + 1; };
        while (cells(low_.x, high.x) * cells(low_.y, high.y) * cells(low_.z, high.z) >
               (float)MOST_CELLS * (float)most(count, 64))
            cell_ *= 2;
        counts_[0] = (int)cells(low_.x, high.x);
        counts_[1] = (int)cells(low_.y, high.y);
        counts_[2] = (int)cells(low_.z, high.z);
        starts_ = work.take<int32_t>(counts_[0] * counts_[1] * counts_[2] + 1);
        order_ = work.room<int32_t>(count);
        for (Array<float> &each : columns_) each = work.take<float>(count + LANES);
        Array<int32_t> slots = work.room<int32_t>(count);
        for (int k = 0; k < count; k++) {
            Vec p = points[k];
            starts_[slots[k] = row(along(p.y, 1), along(p.z, 2)) + along(p.x, 0)]++;
        }
        int sum = 0;
        for (int32_t &start : starts_) sum = start += sum;
        for (int k = count - 1; k >= 0; k--) order_[--starts_[slots[k]]] = k;
        for (int k = 0; k < count; k++) {
            int point = order_[k];
            for (int each = 0; each < 3; each++) {
                columns_[each][k] = axis(points[point], each);
                columns_[3 + each][k] = axis(cloth.rest[point], each);
            }
            columns_[6][k] = (float)cloth.garments[point];
        }
    }

    // Calls act(point, square of its distance) for the points within the reach of a place, without those of
    // the same garment that are within the reach at rest.
    template <class Act> void each_beside(Vec place, Vec rest, int garment, Act act) const {
        Around around{repeat(place), repeat(rest), Lanes{} + (float)garment};
        int left = along(place.x - BESIDE_REACH, 0), right = along(place.x + BESIDE_REACH, 0);
        int front = along(place.y - BESIDE_REACH, 1), back = along(place.y + BESIDE_REACH, 1);
        int bottom = along(place.z - BESIDE_REACH, 2), top = along(place.z + BESIDE_REACH, 2);
        for (int z = bottom; z <= top; z++)
            for (int y = front; y <= back; y++) look(row(y, z) + left, row(y, z) + right + 1, around, act);
    }

  private:
    int along(float place, int axis) const {
        float cells = (place - uvc::axis(low_, axis)) * (1 / cell_);
        return (int)least((float)(counts_[axis] - 1), most(0.0f, cells));
    }

    int row(int y, int z) const { return counts_[0] * (y + counts_[1] * z); }

    struct Around {
        LaneVec place, rest;
        Lanes garment;
    };

    Lanes squares(int column, int first, const LaneVec &from) const {
        Lanes x = load(columns_[column].data + first) - from.x;
        Lanes y = load(columns_[column + 1].data + first) - from.y;
        Lanes z = load(columns_[column + 2].data + first) - from.z;
        return x * x + y * y + z * z;
    }

    template <class Act> void look(int from, int to, const Around &around, Act act) const {
        for (int first = starts_.at(from), last = starts_.at(to); first < last; first += LANES) {
            Lanes apart = squares(0, first, around.place);
            LaneMask counts = is_at_most(Lanes{} + SQUARE, squares(3, first, around.rest)) |
                              ~is_same(load(columns_[6].data + first), around.garment);
            unsigned near = bits(is_below(apart, Lanes{} + SQUARE) & counts);
            if (last - first < LANES) near &= (1u << (last - first)) - 1;
            while (near) {
                int lane = take(near);
                act(order_.at(first + lane), apart[lane]);
            }
        }
    }

    // Metres beyond which no cloth is, and the square of the reach.
    static constexpr float FAR = 1e6f, SQUARE = BESIDE_REACH * BESIDE_REACH;

    Vec low_;
    float cell_;
    int counts_[3];
    Array<int32_t> starts_, order_;
    Array<float> columns_[7];
};

float rises(float from, float to, float at) { return clamp((at - from) / (to - from), 0, 1); }

}  // namespace

void find_near_cloth(const Cloth &cloth, const Vec *points, const Vec *normals, int first, int last,
                     NearCloth *beside, Arena &work) {
    Scope scope(work);
    Grid grid(cloth, points, work);
    for (int k = first; k < last; k++) {
        int garment = cloth.garments[k];
        NearCloth one = {1, {BESIDE_REACH, {}}};
        float nearest = BESIDE_REACH * BESIDE_REACH;
        grid.each_beside(points[k], cloth.rest[k], garment, [&](int other, float squared) {
            if (cloth.garments[other] == garment) {
                float faces = rises(BEGINS_TO_FACE, FACES, dot(normals[k], normals[other]));
                one.open = least(one.open, 1 - faces * rises(BESIDE_REACH, CLOSED, root(squared)));
            } else if (squared < nearest) {
                nearest = squared;
                float height = dot(normals[other], points[k] - points[other]), side = height < 0 ? -1.0f : 1.0f;
                one.other = {side * height, side * normals[other]};
            }
        });
        beside[k - first] = one;
    }
}

}  // namespace uvc
