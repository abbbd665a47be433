/* Opened colliders: parts of a body that a pose presses into each other are pushed apart, so that cloth has
 * room between them. And surfaces as graphs: distances along the skin, from which an opening is made, and edges
 * of cloth that are evened. */
#ifndef UVCLOTH_OPENING_H
#define UVCLOTH_OPENING_H

#include "uvcloth.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Pressed parts of a collider. Immutable: any number of threads may use it. */
typedef struct uvc_opening uvc_opening;

/* Reads the opening of a collider of C `vertices`, as uvc_read_clearing reads an outfit. */
UVC_API uvc_opening *uvc_read_opening(const void *bytes, size_t size, int vertices, char *message,
                                      size_t room);
UVC_API void uvc_free_opening(uvc_opening *opening);

/* Pushes the parts of a collider in so many frames (F, C) apart, in place, each frame by itself. */
UVC_API void uvc_open_frames(const uvc_opening *opening, float *frames, int count);

/* Signed distances (P) of all points to the other parts of their pairs, at vertices (C); 1e9 for none. */
UVC_API void uvc_opening_distances(const uvc_opening *opening, const float *vertices, float *distances);

/* Edges of a surface of so many vertices: the neighbours of each, from starts (vertices + 1) on, and the
 * lengths of the edges to them. */
typedef struct uvc_graph {
    const int32_t *starts, *neighbours;
    const float *lengths;
    int32_t vertices;
} uvc_graph;

/* Chooses vertices, in an order (count), that are at least `spacing` apart along the surface. Sets clear
 * (vertices): for each chosen one the distance within which others were left out for it, -1 for all others. */
UVC_API void uvc_thin_out(const uvc_graph *graph, const int32_t *order, int count, float spacing,
                          float *clear);

/* Evens the edges of cloth at positions (vertices, 3), m, in place, in so many passes: edges come near the
 * graph's lengths, vertices bend little more than at rest, and the shape stays. curvatures: (vertices), m,
 * lengths of the mean ways from vertices to their neighbours at rest. normals (vertices, 3), unit, and offsets
 * (vertices), m: a vertex stays where its product with its normal is no less than its offset. */
UVC_API void uvc_even_edges(const uvc_graph *graph, const float *curvatures, const float *normals,
                            const float *offsets, int passes, float *positions);

#ifdef __cplusplus
}
#endif

#endif
