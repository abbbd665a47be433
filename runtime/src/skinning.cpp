#include "skinning.h"

#include "section_name.h"
#include "shares.h"

namespace uvc {

namespace {

// A row of a transform.
typedef float Row4 __attribute__((vector_size(16)));

UVC_INLINE Row4 load_row(const float *numbers) {
    Row4 row;
    __builtin_memcpy(&row, numbers, sizeof(row));
    return row;
}

struct Transform {
    Row4 x, y, z;
};

UVC_INLINE Transform load_transform(const float *numbers) {
    return {load_row(numbers), load_row(numbers + 4), load_row(numbers + 8)};
}

UVC_INLINE Vec apply(const Transform &transform, Row4 point) {
    Row4 x = transform.x * point, y = transform.y * point, z = transform.z * point;
    Row4 xy = __builtin_shufflevector(x, y, 0, 4, 1, 5) + __builtin_shufflevector(x, y, 2, 6, 3, 7);
    Row4 zz = z + __builtin_shufflevector(z, z, 2, 3, 0, 1);
    return {xy[0] + xy[2], xy[1] + xy[3], zz[0] + zz[1]};
}

}  // namespace

Skin read_skin(const Sections &sections, const char *prefix, int joints, Arena &arena, Failure &failure) {
    Skin skin;
    SectionName rest(prefix, ".rest"), starts(prefix, ".starts"), weights(prefix, ".weights");
    skin.rest = read_floats(sections, rest.text, -1, 3, arena, failure);
    skin.joints =
        read_indices(sections, SectionName(prefix, ".joints").text, -1, 1, 0, joints, arena, failure);
    skin.starts = read_starts(sections, starts.text, skin.vertices(), skin.joints.size, arena, failure);
    skin.weights = read_shares(sections, weights.text, skin.starts, arena, failure);
    return failure.failed ? Skin{} : skin;
}

void pose(const Skin &skin, const float *rest, const float *transforms, Vec *posed) {
    constexpr int SIZE = 12;
    for (int vertex = 0; vertex < skin.vertices(); vertex++) {
        Row4 point = {rest[3 * vertex], rest[3 * vertex + 1], rest[3 * vertex + 2], 1};
        int first = skin.starts[vertex], end = skin.starts[vertex + 1];
        if (end == first + 1 && skin.weights[first] == 1) {
            posed[vertex] = apply(load_transform(transforms + SIZE * skin.joints[first]), point);
            continue;
        }
        Transform blend{};
        for (int k = first; k < end; k++) {
            Transform one = load_transform(transforms + SIZE * skin.joints[k]);
            float weight = skin.weights[k];
            blend = {blend.x + weight * one.x, blend.y + weight * one.y, blend.z + weight * one.z};
        }
        posed[vertex] = apply(blend, point);
    }
}

}  // namespace uvc
