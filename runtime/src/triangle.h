// Closest points on triangles, and rays that meet them.
#pragma once

#include "vector.h"

namespace uvc {

// Three corners of a face, as indices.
struct Face {
    int32_t a, b, c;
    UVC_MEMBER int32_t operator[](int corner) const { return corner == 0 ? a : corner == 1 ? b : c; }
    UVC_MEMBER bool has(int vertex) const { return a == vertex || b == vertex || c == vertex; }
};

UVC_INLINE Vec weighted(Vec weights, Vec a, Vec b, Vec c) {
    return weights.x * a + weights.y * b + weights.z * c;
}

// Barycentric coordinates of the point of a triangle that is closest to a point, by the regions of
// Ericson 2005, "Real-Time Collision Detection", section 5.1.5.
UVC_INLINE Vec closest_barycentrics(Vec point, Vec a, Vec b, Vec c) {
    Vec ab = b - a, ac = c - a, ap = point - a, bp = point - b, cp = point - c;
    float d1 = dot(ab, ap), d2 = dot(ac, ap), d3 = dot(ab, bp);
    float d4 = dot(ac, bp), d5 = dot(ab, cp), d6 = dot(ac, cp);
    if (d1 <= 0 && d2 <= 0) return {1, 0, 0};
    if (d3 >= 0 && d4 <= d3) return {0, 1, 0};
    if (d6 >= 0 && d5 <= d6) return {0, 0, 1};
    float to_c = d1 * d4 - d3 * d2;
    if (to_c <= 0 && d1 >= 0 && d3 <= 0) {
        float along = d1 / (d1 - d3);
        return {1 - along, along, 0};
    }
    float to_b = d5 * d2 - d1 * d6;
    if (to_b <= 0 && d2 >= 0 && d6 <= 0) {
        float along = d2 / (d2 - d6);
        return {1 - along, 0, along};
    }
    float to_a = d3 * d6 - d5 * d4;
    if (to_a <= 0 && d4 >= d3 && d5 >= d6) {
        float along = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        return {0, 1 - along, along};
    }
    float share = 1 / (to_a + to_b + to_c);
    return {1 - (to_b + to_c) * share, to_b * share, to_c * share};
}

// Normal of a face, twice its area long.
UVC_INLINE Vec face_normal(Face face, const Vec *points) {
    return cross(points[face.b] - points[face.a], points[face.c] - points[face.a]);
}

}  // namespace uvc
