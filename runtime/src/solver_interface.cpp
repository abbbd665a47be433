// The C interface of the solver.
#include "solver.h"
#include "stability.h"

struct uvc_solver {
    uvc::Solver data;
};

struct uvc_elastic {
    uvc::Elastic data;
    uvc::Arena arena;
};

struct uvc_pairs {
    uvc::SelfContact data;
    uvc::Arena work;
};

extern "C" {

uvc_solver *uvc_read_solver(const void *bytes, size_t size, char *message, size_t room) {
    auto read = [](const uvc::Sections &sections, uvc_solver &object, uvc::Failure &failure) {
        uvc::read_solver(sections, object.data, failure);
    };
    return uvc::read_object<uvc_solver>(bytes, size, message, room, read);
}

void uvc_free_solver(uvc_solver *solver) { uvc::drop(solver); }

uvc_pairs *uvc_make_pairs(void) { return uvc::make<uvc_pairs>(); }

void uvc_free_pairs(uvc_pairs *pairs) { uvc::drop(pairs); }

void uvc_set_pairs(uvc_pairs *pairs, const int32_t *points, const float *sides, int point_count,
                   const int32_t *edges, const float *directions, int edge_count) {
    uvc::SelfContact &contact = pairs->data;
    contact.points.clear();
    contact.edges.clear();
    const uvc::Vec *ways = reinterpret_cast<const uvc::Vec *>(directions);
    for (int k = 0; k < point_count; k++)
        contact.points.add({{points[2 * k], points[2 * k + 1]}, sides[k], 0});
    for (int k = 0; k < edge_count; k++) contact.edges.add({{edges[2 * k], edges[2 * k + 1]}, ways[k], 0});
}

int uvc_point_pairs(const uvc_pairs *pairs) { return pairs->data.points.items.size; }

int uvc_edge_pairs(const uvc_pairs *pairs) { return pairs->data.edges.items.size; }

void uvc_get_pairs(const uvc_pairs *pairs, int32_t *points, float *sides, int32_t *edges, float *directions) {
    uvc::Vec *ways = reinterpret_cast<uvc::Vec *>(directions);
    for (const uvc::PointPair &pair : pairs->data.points.items) {
        *points++ = pair.indices.first;
        *points++ = pair.indices.second;
        *sides++ = pair.side;
    }
    for (const uvc::EdgePair &pair : pairs->data.edges.items) {
        *edges++ = pair.indices.first;
        *edges++ = pair.indices.second;
        *ways++ = pair.direction;
    }
}

int uvc_solve(const uvc_solver *solver, const uvc_motion *motion, float *positions, float *velocities,
              int32_t *faces, float *clear, uvc_pairs *pairs, char *message, size_t room) {
    uvc::Failure failure{message, room};
    return uvc::step(solver->data, solver->data.material, *motion, reinterpret_cast<uvc::Vec *>(positions),
                     reinterpret_cast<uvc::Vec *>(velocities), {faces, clear}, pairs->data, pairs->work,
                     failure);
}

uvc_elastic *uvc_read_elastic(const void *bytes, size_t size, int vertices, char *message, size_t room) {
    auto read = [vertices](const uvc::Sections &sections, uvc_elastic &object, uvc::Failure &failure) {
        object.data = uvc::read_elastic(sections, vertices, object.arena, failure);
    };
    return uvc::read_object<uvc_elastic>(bytes, size, message, room, read);
}

float uvc_stable_step(const uvc_elastic *elastic, const float *mass, const float *rest) {
    uvc::Arena work;
    uvc::Array<float> masses = work.copy(mass, elastic->data.vertices);
    return uvc::stable_step(elastic->data, masses, reinterpret_cast<const uvc::Vec *>(rest), work);
}

void uvc_free_elastic(uvc_elastic *elastic) { uvc::drop(elastic); }

void uvc_add_forces(const uvc_elastic *elastic, const float *positions, const float *velocities,
                    const float *wind, float *forces) {
    uvc::Arena work;
    int vertices = elastic->data.vertices;
    uvc::Array<uvc::Row> rows = work.take<uvc::Row>(vertices);
    uvc::Array<uvc::Force> sums = work.take<uvc::Force>(vertices);
    for (int k = 0; k < vertices; k++)
        for (int j = 0; j < 3; j++) {
            rows[k].numbers[j] = positions[3 * k + j];
            rows[k].numbers[4 + j] = velocities[3 * k + j];
            sums[k][j] = forces[3 * k + j];
        }
    uvc::add_membrane_forces(elastic->data.membrane, rows.data, {wind[0], wind[1], wind[2]}, sums.data);
    uvc::add_hinge_forces(elastic->data.hinges, rows.data, 1, sums.data);
    for (int k = 0; k < vertices; k++)
        for (int j = 0; j < 3; j++) forces[3 * k + j] = sums[k][j];
}

}  // extern "C"
