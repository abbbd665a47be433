/* Measures of cloth: the faces that rays meet, closest points and their sides, edges through faces, and points
 * on faces. */
#ifndef UVCLOTH_MEASURES_H
#define UVCLOTH_MEASURES_H

#include "uvcloth.h"

#ifdef __cplusplus
extern "C" {
#endif

/* A triangle mesh of V vertices and F faces that moves, open or closed. One thread at a time moves it; while
 * it stays, any number of threads may follow rays. */
typedef struct uvc_shell uvc_shell;

/* Makes a mesh of vertices (V, 3), m, and faces (F, 3), both of which are copied. Returns NULL and a sentence,
 * as uvc_read does, for a face with a corner that is no vertex. Give it back by uvc_free_shell. */
UVC_API uvc_shell *uvc_make_shell(const float *vertices, int vertex_count, const int32_t *faces,
                                  int face_count, char *message, size_t room);
UVC_API void uvc_free_shell(uvc_shell *shell);

/* Moves a mesh to vertices (V, 3), m. */
UVC_API void uvc_move_shell(uvc_shell *shell, const float *vertices);

/* Follows rays from starts (R, 3), m, along unit directions (R, 3) to the first face that each one meets
 * within reach, m. Sets faces (R), -1 for none; distances (R), m, 1e9 for none; cosines (R) between ray and
 * normal there, negative from outside, and weights (R, 3), barycentric coordinates, both 0 for none. Eight rays
 * in a row are followed together: they are fast where they lie together. */
UVC_API void uvc_first_hits(const uvc_shell *shell, const float *starts, const float *directions, int count,
                            float reach, int32_t *faces, float *distances, float *cosines, float *weights);

/* One or several triangle meshes over the same V vertices, which move. One thread at a time moves them; while
 * they stay, any number of threads may search them. No search reaches farther than 10 km, and a point that is
 * not finite has nothing within reach. */
typedef struct uvc_meshes uvc_meshes;

/* Makes `count` meshes of vertices (V, 3), m, and faces (F, 3), each from its first one in starts (count + 1)
 * up to that of the next; all are copied. Meshes may have no faces. Returns NULL and a sentence, as uvc_read
 * does, for a face with a corner that is no vertex, and for more than 31 meshes. Give them back by
 * uvc_free_meshes. */
UVC_API uvc_meshes *uvc_make_meshes(const float *vertices, int vertex_count, const int32_t *faces,
                                    const int32_t *starts, int count, char *message, size_t room);
UVC_API void uvc_free_meshes(uvc_meshes *meshes);

/* Moves all meshes to vertices (V, 3), m. */
UVC_API void uvc_move_meshes(uvc_meshes *meshes, const float *vertices);

/* Finds the face of a mesh that is closest to each of points (P, 3), m, of several the first. Sets faces (P),
 * counted from the mesh's first one, -1 for none within reach, m, and weights (P, 3), barycentric coordinates
 * of the closest points, 0 for none. */
UVC_API void uvc_closest_faces(const uvc_meshes *meshes, int mesh, const float *points, int count,
                               float reach, int32_t *faces, float *weights);

/* The same with the side of a closed mesh that each point is on. Sets also distances (P), m, negative inside,
 * the reach for none; places (P, 3), m, the closest points, for none the points themselves; and normals (P, 3),
 * the unit directions in which the distances grow, 0 for none. A mesh that crosses itself has one inside. */
UVC_API void uvc_signed_distances(const uvc_meshes *meshes, int mesh, const float *points, int count,
                                  float reach, int32_t *faces, float *weights, float *distances, float *places,
                                  float *normals);

/* Finds the mesh that each of points (P, 3), m, is deepest in or nearest to, of those with a bit set in touches
 * (P). Sets distances (P), m, negative inside, the reach for none; the plane through the closest point, as
 * normals (P, 3), unit, and offsets (P), m, its product with them, both 0 for none; and gaps (P), m, the room
 * between this mesh and the nearest one that faces it, negative where they overlap, 10 for none. Meshes that a
 * point is outside of, and farther from than `exact`, m, count as that far away. Gaps above `narrow`, m, need
 * not be the least. */
UVC_API void uvc_nearest_meshes(const uvc_meshes *meshes, const int32_t *touches, const float *points,
                                int count, float reach, float exact, float narrow, float *distances,
                                float *normals, float *offsets, float *gaps);

/* Tests edges (E, 2), each between two vertices, for faces of a mesh that they run through and that have no
 * corner at the place of either end. Sets crosses (E), 1 or 0. All edges have to have their ends among the
 * vertices. */
UVC_API void uvc_crossing_edges(const uvc_meshes *meshes, int mesh, const int32_t *edges, int count,
                                uint8_t *crosses);

/* Sets points (P, 3), m, with the barycentric coordinates weights (P, 3) on faces (P, 3) of vertices (V, 3), m,
 * and the unit normals (P, 3) of these faces. All faces have to have their corners among the vertices. */
UVC_API void uvc_sample(const float *vertices, const int32_t *faces, const float *weights, int count,
                        float *points, float *normals);

#ifdef __cplusplus
}
#endif

#endif
