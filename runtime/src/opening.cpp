#include "opening.h"

namespace uvc {

namespace {

// Times that distances are measured and pushes corrected.
constexpr int ROUNDS = 5;

// Sum of the weights, 1/m4, from which a distance counts in full: that of one facing point 6 cm away.
constexpr float FULL_WEIGHT = 1e4f;

// Metres along the wall, from a point to the middle of the wall points that measure it, up to which it has
// full weight. At twice this distance its weight is zero, because a tangent plane extends beyond the end of
// the wall.
constexpr float LATERAL = 0.03f;

// 0 up to 0, 1 from 1 on, without a kink.
float smooth_step(float value) {
    value = clamp(value, 0, 1);
    return value * value * (3 - 2 * value);
}

// Metres by which a point is too near its wall, less where its distance is not known well.
float missing(const Opening &opening, int row, const Measured &measured) {
    float lack = opening.want[row] - measured.distance();
    return lack * smooth_step(measured.weight / FULL_WEIGHT) *
           smooth_step(2 - lateral_distance(measured) / LATERAL);
}

float allowed(const Opening &opening, int side, int vertex) {
    return opening.allowed[side * opening.vertices + vertex];
}

// Finds the points of a tile that are too near their wall. Returns the number of all so far.
int find_pushed(const Opening &opening, OpeningWork &work, int side, int tile, int amount) {
    Array<OpposingTiles> facing = find_facing(opening.sides, work.walls, side, tile);
    for (int row = LANES * tile; facing.size && row < LANES * (tile + 1); row++) {
        int vertex = opening.sides.vertices[row];
        if (vertex < 0) break;
        float longest = allowed(opening, side, vertex);
        if (longest <= 0) continue;
        Measured measured = measure(work.walls, row, facing);
        if (measured.weight <= 0 || measured.distance() >= opening.want[row]) continue;
        float lack = missing(opening, row, measured), limit = least(most(lack, 0.0f), longest);
        if (limit > 0) work.pushed[amount++] = {row, side, least(0.5f * lack, limit), limit, measured.wall};
    }
    return amount;
}

// Finds all points that are too near their wall, with their first pushes: half of what is missing.
Array<Push> find_pushed(const Opening &opening, OpeningWork &work) {
    const Sides &sides = opening.sides;
    int amount = 0;
    for (int side = 0; side < sides.sides; side++)
        for (int group = sides.starts[side]; group < sides.starts[side + 1]; group++)
            for (int lane = 0; lane < LANES; lane++)
                if (work.walls.near[group] >> lane & 1)
                    amount = find_pushed(opening, work, side, LANES * group + lane, amount);
    return work.pushed.part(0, amount);
}

// Corrects pushes by half of what is missing where the points are now.
void correct(const Opening &opening, OpeningWork &work, Array<Push> pushed) {
    Array<OpposingTiles> facing;
    int tile = -1;
    for (Push &point : pushed) {
        if (point.row / LANES != tile) {
            tile = point.row / LANES;
            facing = find_facing(opening.sides, work.walls, point.side, tile);
        }
        Measured measured = measure(work.walls, point.row, facing);
        point.way = measured.wall;
        if (measured.weight <= 0) continue;
        float lack = missing(opening, point.row, measured);
        point.push = clamp(point.push + 0.5f * lack, 0, point.limit);
    }
}

// Adds the push of a point to the vertices around it, reduced by the slope along the skin.
int spread(const Opening &opening, OpeningWork &work, const Push &point, int amount) {
    float size = length(point.way);
    if (size <= 0) return amount;
    Vec way = (1.0f / size) * point.way;
    int vertex = opening.sides.vertices[point.row];
    for (int k = opening.spread.starts[vertex]; k < opening.spread.starts[vertex + 1]; k++) {
        int other = opening.spread.others.items[k];
        float left = point.push - opening.slope * opening.spread.ways.items[k];
        if (left <= 0) break;
        if (allowed(opening, point.side, other) <= 0) continue;
        if (!work.is_active[other]) {
            work.is_active[other] = 1;
            work.active[amount++] = other;
        }
        VertexPush &meeting = work.meetings[other];
        meeting.longest = most(meeting.longest, left);
        meeting.total += left;
        meeting.way += left * way;
    }
    return amount;
}

// Moves vertices of a side by the longest push that meets there, in the mean direction of all.
void settle(const Opening &opening, OpeningWork &work, int side, int amount) {
    for (int vertex : work.active.part(0, amount)) {
        VertexPush &meeting = work.meetings[vertex];
        if (meeting.total <= 0) continue;
        float longest = least(meeting.longest, allowed(opening, side, vertex));
        work.shift[vertex] += (longest / meeting.total) * meeting.way;
        meeting = {};
    }
}

// Makes the shifts of all vertices from the pushes. Returns the number of active vertices.
int shift(const Opening &opening, OpeningWork &work, Array<Push> pushed, int amount) {
    for (int vertex : work.active.part(0, amount)) work.shift[vertex] = {};
    for (int k = 0; k < pushed.size; k++) {
        amount = spread(opening, work, pushed[k], amount);
        if (k + 1 == pushed.size || pushed[k + 1].side != pushed[k].side)
            settle(opening, work, pushed[k].side, amount);
    }
    return amount;
}

// Moves the points along with their vertices.
void follow(const Opening &opening, OpeningWork &work, const Vec *corners, int amount) {
    for (int vertex : work.active.part(0, amount)) {
        Vec place = corners[vertex] + work.shift[vertex];
        for (int k = opening.row_starts[vertex]; k < opening.row_starts[vertex + 1]; k++) {
            int row = opening.vertex_rows[k];
            float(*places)[LANES] = work.walls.tiles[row / LANES].place;
            places[0][row % LANES] = place.x;
            places[1][row % LANES] = place.y;
            places[2][row % LANES] = place.z;
        }
    }
}

// Moves the tip of each cap by the mean shift of its rim.
void move_tips(const Opening &opening, const OpeningWork &work, Vec *corners) {
    for (int tip = 0; tip < opening.tips.size; tip++) {
        Array<int32_t> rim = opening.rims.part(opening.rim_starts[tip], opening.rim_starts[tip + 1]);
        Vec total{};
        for (int vertex : rim) total += work.shift[vertex];
        if (rim.size) corners[opening.tips[tip]] += (1.0f / (float)rim.size) * total;
    }
}

// Places in the groups of each vertex.
void find_rows(Opening &opening, Arena &arena) {
    const Sides &sides = opening.sides;
    opening.row_starts = arena.take<int32_t>(opening.vertices + 1);
    opening.vertex_rows = arena.take<int32_t>(sides.points.size);
    for (int vertex : sides.points) opening.row_starts[vertex + 1]++;
    for (int k = 0; k < opening.vertices; k++) opening.row_starts[k + 1] += opening.row_starts[k];
    Arena work;
    Array<int32_t> ends = work.copy(opening.row_starts);
    for (int point = 0; point < sides.points.size; point++)
        opening.vertex_rows[ends[sides.points[point]]++] = sides.rows[point];
}

// Vertices of the skin at rest, m: no more than so many.
Array<Vec> read_skin_rest(const Sections &sections, int vertices, Arena &arena, Failure &failure) {
    Array<float> rest = read_floats(sections, "skin.rest", -1, 3, arena, failure);
    if (rest.size / 3 > vertices) failure.say("the skin of the outfit has more vertices than its collider");
    return {reinterpret_cast<Vec *>(rest.data), rest.size / 3};
}

}  // namespace

void read_opening(const Sections &sections, int vertices, Opening &opening, Arena &arena, Failure &failure) {
    Arena work;
    opening.vertices = vertices;
    Array<Vec> rest = read_skin_rest(sections, vertices, work, failure);
    Array<int32_t> corners = read_faces(sections, "opening.faces", rest.size, work, failure);
    Array<Face> faces{reinterpret_cast<Face *>(corners.data), corners.size / 3};
    Array<float> clear = read_floats(sections, "opening.clear", vertices, 1, work, failure);
    float reach = read_number(sections, "opening.reach", failure);
    if (failure.failed) return;
    Graph graph = make_graph(faces, rest.data, vertices, work);
    opening.sides = read_sides(sections, faces, graph, arena, failure);
    int count = opening.sides.sides, points = opening.sides.points.size;
    Array<float> want = read_floats(sections, "opening.want", points, 1, work, failure);
    opening.allowed = read_floats(sections, "opening.allowed", count, vertices, arena, failure);
    opening.slope = read_number(sections, "opening.slope", failure);
    opening.tips = read_indices(sections, "opening.tips", -1, 1, 0, vertices, arena, failure);
    opening.rims = read_indices(sections, "opening.rims", -1, 1, 0, vertices, arena, failure);
    opening.rim_starts =
        read_starts(sections, "opening.rim_starts", opening.tips.size, opening.rims.size, arena, failure);
    if (failure.failed) return;
    if (!along_skin(graph, clear.data, reach, opening.spread, arena))
        failure.say("opening.reach of the outfit takes in too much of the skin");
    opening.want = arena.take<float>(opening.sides.vertices.size);
    for (int point = 0; point < points; point++) opening.want[opening.sides.rows[point]] = want[point];
    find_rows(opening, arena);
}

OpeningWork make_opening_work(const Opening &opening, Arena &arena) {
    int vertices = opening.vertices;
    return {make_walls(opening.sides, arena),  arena.take<Push>(opening.sides.points.size),
            arena.take<VertexPush>(vertices),     arena.take<Vec>(vertices),
            arena.take<int32_t>(vertices),     arena.take<uint8_t>(vertices)};
}

void open_frame(const Opening &opening, OpeningWork &work, Vec *corners) {
    raise_walls(opening.sides, corners, work.walls);
    Array<Push> pushed = find_pushed(opening, work);
    if (!pushed.size) return;
    int amount = shift(opening, work, pushed, 0);
    for (int round = 1; round < ROUNDS; round++) {
        follow(opening, work, corners, amount);
        correct(opening, work, pushed);
        amount = shift(opening, work, pushed, amount);
    }
    for (int vertex : work.active.part(0, amount)) corners[vertex] += work.shift[vertex];
    move_tips(opening, work, corners);
    for (int vertex : work.active.part(0, amount)) {
        work.shift[vertex] = {};
        work.is_active[vertex] = 0;
    }
}

}  // namespace uvc
