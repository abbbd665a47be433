// The C interface of opened colliders and of surfaces as graphs.
#include "uvcloth_opening.h"

#include "edge_evening.h"
#include "opening.h"
#include "surface_graph.h"

struct uvc_opening {
    uvc::Opening data;
    uvc::Arena arena;
};

namespace uvc {

namespace {

Graph graph_of(const uvc_graph &graph) {
    int edges = graph.starts[graph.vertices];
    return {{graph.starts, graph.vertices + 1}, {graph.neighbours, edges}, {graph.lengths, edges}};
}

}  // namespace

}  // namespace uvc

extern "C" {

uvc_opening *uvc_read_opening(const void *bytes, size_t size, int vertices, char *message, size_t room) {
    auto read = [vertices](const uvc::Sections &sections, uvc_opening &object, uvc::Failure &failure) {
        uvc::read_opening(sections, vertices, object.data, object.arena, failure);
    };
    return uvc::read_object<uvc_opening>(bytes, size, message, room, read);
}

void uvc_free_opening(uvc_opening *opening) { uvc::drop(opening); }

void uvc_open_frames(const uvc_opening *opening, float *frames, int count) {
    uvc::Arena arena;
    uvc::OpeningWork work = uvc::make_opening_work(opening->data, arena);
    uvc::Vec *corners = reinterpret_cast<uvc::Vec *>(frames);
    for (int frame = 0; frame < count; frame++, corners += opening->data.vertices)
        uvc::open_frame(opening->data, work, corners);
}

void uvc_opening_distances(const uvc_opening *opening, const float *vertices, float *distances) {
    uvc::measure_all(opening->data.sides, reinterpret_cast<const uvc::Vec *>(vertices), distances);
}

void uvc_thin_out(const uvc_graph *graph, const int32_t *order, int count, float spacing, float *clear) {
    uvc::thin_out(uvc::graph_of(*graph), {order, count}, spacing, clear);
}

void uvc_even_edges(const uvc_graph *graph, const float *curvatures, const float *normals, const float *offsets,
                    int passes, float *positions) {
    uvc::Evening evening{curvatures, reinterpret_cast<const uvc::Vec *>(normals), offsets};
    uvc::even_edges(uvc::graph_of(*graph), evening, passes, reinterpret_cast<uvc::Vec *>(positions));
}

}  // extern "C"
