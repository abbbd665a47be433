/* The runtime of uvcloth: garments that follow a body without Python.
 *
 * Conventions. Lengths are in metres, the z axis points up. Positions are float triples, x y z, one vertex
 * after another. N vertices of cloth, V of the skin, C of the collider. Nothing here is global: functions on
 * different objects may run at the same time. The same input gives the same bits on one machine.
 *
 * Bytes of an outfit are those that `uvcloth.player.sections.pack` writes; they may be freed after reading.
 */
#ifndef UVCLOTH_H
#define UVCLOTH_H

#include <stddef.h>
#include <stdint.h>

#if defined(_WIN32)
#define UVC_API __declspec(dllexport)
#else
#define UVC_API __attribute__((visibility("default")))
#endif

#ifdef __cplusplus
extern "C" {
#endif

/* Whether this processor runs code for x86-64-v3 (AVX2, FMA, BMI2). */
UVC_API int uvc_has_v3(void);

/* --- A character in a baked outfit: joints in, vertices out, a frame at a time ---------------------------- */

/* An outfit as it was baked for one body. Immutable: any number of characters and threads may use it. */
typedef struct uvc_outfit uvc_outfit;

/* Reads an outfit. Returns NULL and a sentence of at most `room` bytes, with its zero, in `message` if the
 * bytes are cut, damaged, of another version, or do not fit together. */
UVC_API uvc_outfit *uvc_read(const void *bytes, size_t size, char *message, size_t room);
UVC_API void uvc_free(uvc_outfit *outfit);

/* Number of joints J, of garments, the innermost first, and of a garment's vertices. */
UVC_API int uvc_joints(const uvc_outfit *outfit);
UVC_API int uvc_garments(const uvc_outfit *outfit);
UVC_API int uvc_garment_vertices(const uvc_outfit *outfit, int garment);

/* The cloth of one character that wears the outfit, which has to outlive it. One thread at a time. */
typedef struct uvc_cloth uvc_cloth;
UVC_API uvc_cloth *uvc_new(const uvc_outfit *outfit);
UVC_API void uvc_drop(uvc_cloth *cloth);

/* Lets cloth come to rest on the body in its first pose, where uvc_vertices has it then. joints: (J, 3, 4), row
 * by row, the transforms of the joints from the rest pose: a turn, without scale, and a shift in metres, in any
 * place of the world. Takes as long as 65 steps. Returns 1, or 0 and a sentence, as uvc_read does, for joints
 * that are not finite and cloth that finds no rest, which has to be started again. */
UVC_API int uvc_start(uvc_cloth *cloth, const double *joints, char *message, size_t room);

/* Moves cloth on to the pose of joints, `seconds` later. The first step after uvc_start is to the pose of the
 * first frame. Where the root jumps, its speed changing by more than 10 m/s or its turn being faster than 45
 * radians/s, the cloth comes along as it hangs. Returns 1, or 0 and a sentence for cloth that was not
 * started, joints that are not finite, a body that is faster than 40 m/s past the cloth, a frame without
 * length, and cloth that flies apart; the cloth stays as it was then. */
UVC_API int uvc_step(uvc_cloth *cloth, const double *joints, double seconds, char *message, size_t room);

/* Pulls the cages, on which the cloth is solved, to points (n, 3), m, in the world of the joints, by springs of
 * a frequency `rate`, 1/s, in all steps until the next call; 0 ends it, and needs no points. uvc_start then
 * starts from these points. uvc_cages: n. */
UVC_API void uvc_pull(uvc_cloth *cloth, const double *points, double rate);
UVC_API int uvc_cages(const uvc_outfit *outfit);

/* Number m of the cages' faces, and their corners (m, 3), vertices of uvc_cage_vertices. */
UVC_API int uvc_cage_faces(const uvc_outfit *outfit);
UVC_API void uvc_cage_corners(const uvc_outfit *outfit, int32_t *corners);

/* Wind (3), m/s, and gravity (3), m/s2, in the world of the joints, in all steps until the next call; before
 * the first one no wind, and 9.81 m/s2 downwards. Wind blows through the body. Returns 1, or 0 and a
 * sentence, and changes nothing, for more than 100 m/s or m/s2, and for numbers that are not finite. */
UVC_API int uvc_set_world(uvc_cloth *cloth, const double *wind, const double *gravity, char *message,
                          size_t room);

/* Changes the fabric of a garment: factors on its weight per area, and on its stiffness in the plane and in
 * bending, as it was baked, from 0.01 to 100. Frames get as many substeps as the new fabric needs. Returns 1,
 * or 0 and a sentence, and changes nothing, for other factors, or a garment that is not there. */
UVC_API int uvc_set_fabric(uvc_cloth *cloth, int garment, double density, double stretch, double bend,
                           char *message, size_t room);

/* All that the cloth remembers, as so many bytes: written, and read again by cloth in the same outfit, which
 * goes on from there. uvc_restore returns 0 for other bytes, and changes nothing then. They are for this
 * machine and this version. */
UVC_API size_t uvc_saved_size(const uvc_cloth *cloth);
UVC_API void uvc_save(const uvc_cloth *cloth, void *bytes);
UVC_API int uvc_restore(uvc_cloth *cloth, const void *bytes, size_t size);

/* Copies the vertices of a garment (V, 3), and those of all cages (n, 3), m, in the world of the joints. */
UVC_API void uvc_cage_vertices(const uvc_cloth *cloth, double *vertices);
UVC_API void uvc_vertices(const uvc_cloth *cloth, int garment, double *vertices);

/* --- Clearing: garments that lie in the skin by some millimetres are moved off it ----------------------- */

/* Fine meshes of an outfit and the body that they are kept off. Immutable: any number of threads may use it. */
typedef struct uvc_clearing uvc_clearing;

/* Reads an outfit. Returns NULL and a sentence of at most `room` bytes, with its zero, in `message` if the
 * bytes are cut, damaged, of another version, or do not fit together. Give it back by uvc_free_clearing. */
UVC_API uvc_clearing *uvc_read_clearing(const void *bytes, size_t size, char *message, size_t room);
UVC_API void uvc_free_clearing(uvc_clearing *clearing);

/* Bytes of the memory from frame to frame, which the caller brings and may copy at any time. */
UVC_API size_t uvc_clearing_memory(const uvc_clearing *clearing);

/* Sets memory up before the first frame, from which nothing is known. */
UVC_API void uvc_begin_clearing(const uvc_clearing *clearing, void *memory);

/* Moves cloth (N) to at least `clearance` off the collider (C), in place. Both are around one origin, which
 * may change from frame to frame. Cloth deeper in the body than `reach` stays there. */
UVC_API void uvc_clear(const uvc_clearing *clearing, void *memory, float *cloth, const float *collider,
                       float clearance, float reach);

/* Moves cloth (N) over the skin (V) that it covers at rest and that comes through its faces, in place. */
UVC_API void uvc_cover(const uvc_clearing *clearing, float *cloth, const float *skin);

/* Moves outer garments of cloth (N) to `clearance` off those beneath them, one after another, in place.
 * turns: times that each is moved; after all but the last one neighbours follow. */
UVC_API void uvc_lift(const uvc_clearing *clearing, float *cloth, float clearance, int turns);

/* --- Wrinkles: folds on finer meshes, which a network makes ---------------------------------------------- */

/* A network and the garments that it makes wrinkles on, P points and n vertices of finer meshes in all.
 * Immutable: any number of threads may use it. */
typedef struct uvc_wrinkles uvc_wrinkles;

/* Reads wrinkles, as uvc_read_clearing reads an outfit. */
UVC_API uvc_wrinkles *uvc_read_wrinkles(const void *bytes, size_t size, char *message, size_t room);
UVC_API void uvc_free_wrinkles(uvc_wrinkles *wrinkles);

/* Number n of vertices. */
UVC_API int uvc_wrinkled_vertices(const uvc_wrinkles *wrinkles);

/* Bytes of the memory from frame to frame, which the caller brings, and what it is before the first frame. */
UVC_API size_t uvc_wrinkle_memory(const uvc_wrinkles *wrinkles);
UVC_API void uvc_begin_wrinkles(const uvc_wrinkles *wrinkles, void *memory);

/* Sets vertices (n), with wrinkles, of the garments at points (P) on a body with skin (V), `seconds` after the
 * frame before; all frames are around one origin. */
UVC_API void uvc_wrinkle(const uvc_wrinkles *wrinkles, void *memory, const float *points, const float *skin,
                         double seconds, float *vertices);

/* --- The solver: cloth moves through a frame ------------------------------------------------------------- */

/* Cloth and the body that it collides with. Immutable: any number of threads may use it. */
typedef struct uvc_solver uvc_solver;

/* Reads cloth, as uvc_read_clearing reads an outfit. */
UVC_API uvc_solver *uvc_read_solver(const void *bytes, size_t size, char *message, size_t room);
UVC_API void uvc_free_solver(uvc_solver *solver);

/* Parts of cloth that are near each other, with the sides on which they stay, from frame to frame; also the
 * memory that a step needs. One belongs to one cloth at a time. */
typedef struct uvc_pairs uvc_pairs;
UVC_API uvc_pairs *uvc_make_pairs(void);
UVC_API void uvc_free_pairs(uvc_pairs *pairs);

/* Copies pairs in and out: points (P, 2), a vertex and a face; sides (P), +1 or -1 along the normal of the
 * face; edges (Q, 2); directions (Q, 3), unit, from the second edge to the first. */
UVC_API void uvc_set_pairs(uvc_pairs *pairs, const int32_t *points, const float *sides, int point_count,
                           const int32_t *edges, const float *directions, int edge_count);
UVC_API int uvc_point_pairs(const uvc_pairs *pairs);
UVC_API int uvc_edge_pairs(const uvc_pairs *pairs);
UVC_API void uvc_get_pairs(const uvc_pairs *pairs, int32_t *points, float *sides, int32_t *edges,
                           float *directions);

/* All that moves cloth in a frame, in a frame of reference that moves evenly.
 *
 * body_start, body_end: (C) before and after the frame. target_start, target_end: (N) that vertices are
 * pulled to, with the frequency pull (N), 1/s, and the damping ratio damping (N); frequency 0 is not pulled.
 * acceleration: (N) m/s2 from outside, or NULL. gravity: m/s2. drift: m/s, of the frame of reference through
 * the air. seconds: of the frame. radius: kept between cloth and body; self_radius: between pieces of cloth;
 * fold_radius: within a piece, but no more than at rest; self_margin: more within which cloth is watched.
 * reach: how near the body, and how deep in it, cloth is looked for. needed: substeps a second, at least.
 * interval: s between two searches for the body and for cloth near cloth; less for a body that moves fast.
 * hinge_interval: substeps between two evaluations of the hinges. frame: number of earlier frames. renewal:
 * frames from one search of all faces of the body for a vertex to the next. self_contact: 0 leaves it out. */
typedef struct uvc_motion {
    const float *body_start, *body_end, *target_start, *target_end, *pull, *damping, *acceleration;
    float drift[3], gravity[3];
    float seconds, radius, self_radius, fold_radius, self_margin, reach, needed, interval;
    int32_t hinge_interval, frame, renewal, self_contact;
} uvc_motion;

/* Moves positions and velocities (N), m/s, through a frame. faces (K, N), clear (K, N): search results for
 * each of K parts of the body, -1 and 0 before the first frame. A frame in which cloth flies apart, a vertex
 * not finite or faster than 200 m/s, is repeated with twice the substeps, and once more. Returns the substeps
 * of the frame, or 0 for cloth that flies apart, or -1 for a body that is faster than 40 m/s past the cloth and
 * a frame that is too long; then with a sentence, as uvc_read, and everything as it was. */
UVC_API int uvc_solve(const uvc_solver *solver, const uvc_motion *motion, float *positions, float *velocities,
                      int32_t *faces, float *clear, uvc_pairs *pairs, char *message, size_t room);

/* Faces and hinges of cloth alone, of so many vertices: for the longest stable step. */
typedef struct uvc_elastic uvc_elastic;
UVC_API uvc_elastic *uvc_read_elastic(const void *bytes, size_t size, int vertices, char *message,
                                      size_t room);
UVC_API void uvc_free_elastic(uvc_elastic *elastic);

/* Longest stable step, s, of the solver for cloth of masses (N), kg, at rest (N). */
UVC_API float uvc_stable_step(const uvc_elastic *elastic, const float *mass, const float *rest);

/* Adds the forces (N), N, of all faces and hinges at positions (N) and velocities (N). wind: (3) m/s. */
UVC_API void uvc_add_forces(const uvc_elastic *elastic, const float *positions, const float *velocities,
                            const float *wind, float *forces);

#ifdef __cplusplus
}
#endif

#endif
