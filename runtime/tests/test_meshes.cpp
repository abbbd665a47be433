// Searches of moving meshes beside trying every face, with damaged vertices and points among them.
#include <stdio.h>
#include <stdlib.h>

#include "triangle.h"
#include "uvcloth_measures.h"

using namespace uvc;

namespace {

constexpr int VERTICES = 60, MOST_FACES = 200, POINTS = 40, EDGES = 40, MESHES = 4, ROUNDS = 400;
constexpr float REACH = 0.4f;

// Numbers from -1 to 1 that look random, the same in every run (xorshift).
struct Random {
    uint32_t state = 1;
    uint32_t bits() {
        state ^= state << 13;
        state ^= state >> 17;
        state ^= state << 5;
        return state;
    }
    float next() { return (float)(bits() / 2147483648.0 - 1); }
    int below(int count) { return (int)(bits() % (uint32_t)count); }
    Vec vector() { return {next(), next(), next()}; }
};

void expect(bool holds, const char *sentence) {
    if (holds) return;
    puts(sentence);
    exit(1);
}

// A number that no position should be.
float damaged(Random &random) {
    const float numbers[] = {__builtin_nanf(""), __builtin_inff(), -__builtin_inff(), 1e38f, -1e-40f};
    return numbers[random.below(5)];
}

// The least distance of a point from some faces, m.
float least_distance(const int32_t *faces, int first, int last, const Vec *points, Vec point) {
    float best = REACH;
    for (int k = first; k < last; k++) {
        Vec a = points[faces[3 * k]], b = points[faces[3 * k + 1]], c = points[faces[3 * k + 2]];
        best = least(best, length(point - weighted(closest_barycentrics(point, a, b, c), a, b, c)));
    }
    return best;
}

}  // namespace

int main() {
    Random random;
    int faces_met = 0, crossed = 0;
    for (int round = 0; round < ROUNDS; round++) {
        bool is_damaged = round % 2;
        Vec vertices[VERTICES], points[POINTS], places[POINTS], normals[POINTS], weights[POINTS];
        int32_t faces[3 * MOST_FACES], starts[MESHES + 1], closest[POINTS], touches[POINTS], edges[2 * EDGES];
        float distances[POINTS], offsets[POINTS], gaps[POINTS];
        uint8_t crosses[EDGES];
        char message[200];
        int count = random.below(MOST_FACES + 1);
        for (Vec &vertex : vertices) vertex = random.vector();
        for (int k = 0; k < 3 * count; k++) faces[k] = random.below(VERTICES);
        starts[0] = 0;
        for (int k = 1; k < MESHES; k++) starts[k] = starts[k - 1] + random.below(count - starts[k - 1] + 1);
        starts[MESHES] = count;
        for (int k = 0; k < POINTS; k++) {
            points[k] = random.vector();
            touches[k] = (int32_t)random.bits();
        }
        for (int32_t &end : edges) end = random.below(VERTICES);
        uvc_meshes *meshes = uvc_make_meshes(&vertices[0].x, VERTICES, faces, starts, MESHES, message, 200);
        expect(meshes, "meshes are refused");
        for (Vec &vertex : vertices) vertex = random.vector();
        if (is_damaged)
            for (int k = 0; k < 5; k++) {
                vertices[random.below(VERTICES)].y = damaged(random);
                points[random.below(POINTS)].z = damaged(random);
            }
        uvc_move_meshes(meshes, &vertices[0].x);
        for (int mesh = 0; mesh < MESHES; mesh++) {
            uvc_signed_distances(meshes, mesh, &points[0].x, POINTS, REACH, closest, &weights[0].x, distances,
                                 &places[0].x, &normals[0].x);
            uvc_closest_faces(meshes, mesh, &points[0].x, POINTS, is_damaged ? damaged(random) : REACH, closest,
                              &weights[0].x);
            uvc_crossing_edges(meshes, mesh, edges, EDGES, crosses);
            for (uint8_t is_crossing : crosses) crossed += is_crossing;
            for (int k = 0; k < POINTS; k++) {
                expect(closest[k] >= -1 && closest[k] < starts[mesh + 1] - starts[mesh], "a face is none");
                faces_met += closest[k] >= 0;
                if (is_damaged) continue;
                float expected = least_distance(faces, starts[mesh], starts[mesh + 1], vertices, points[k]);
                expect(absolute(absolute(distances[k]) - expected) < 1e-4f, "a closer face is left out");
            }
        }
        uvc_nearest_meshes(meshes, touches, &points[0].x, POINTS, REACH, random.next(), 0.004f, distances,
                           &normals[0].x, offsets, gaps);
        uvc_free_meshes(meshes);
    }
    printf("%d faces are near points, %d edges cross meshes\n", faces_met, crossed);
    expect(faces_met > 1000 && crossed > 1000, "hardly anything is near");
    return 0;
}
