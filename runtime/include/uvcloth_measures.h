/* Measures of cloth: the faces that rays meet, and points on faces. */
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

/* Sets points (P, 3), m, with the barycentric coordinates weights (P, 3) on faces (P, 3) of vertices (V, 3), m,
 * and the unit normals (P, 3) of these faces. All faces have to have their corners among the vertices. */
UVC_API void uvc_sample(const float *vertices, const int32_t *faces, const float *weights, int count,
                        float *points, float *normals);

#ifdef __cplusplus
}
#endif

#endif
