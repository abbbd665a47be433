#include "walls.h"

#include "lanes.h"

namespace uvc {

namespace {

// Metres within which points of two parts act on each other; points that are deeper inside stay there.
constexpr float REACH = 0.08f;

// Cosine between normals below which two skins face each other: the far side of a limb does not count.
constexpr float FACING = 0.5f;

// Metres that stand for no distance.
constexpr float FAR = 1e9f;

// Most sides: all pairs of 31 parts.
constexpr int MOST_SIDES = 930;

UVC_INLINE LaneVec load_columns(const float (*columns)[LANES]) {
    return {load(columns[0]), load(columns[1]), load(columns[2])};
}

UVC_INLINE Vec pick(const float (*columns)[LANES], int lane) {
    return {columns[0][lane], columns[1][lane], columns[2][lane]};
}

UVC_INLINE void put(float (*columns)[LANES], int lane, Vec a) {
    columns[0][lane] = a.x;
    columns[1][lane] = a.y;
    columns[2][lane] = a.z;
}

// A box around points, m.
struct Range {
    Vec low{FAR, FAR, FAR}, high{-FAR, -FAR, -FAR};
};

UVC_INLINE void widen(Range &range, Vec low, Vec high) {
    range.low = {least(range.low.x, low.x), least(range.low.y, low.y), least(range.low.z, low.z)};
    range.high = {most(range.high.x, high.x), most(range.high.y, high.y), most(range.high.z, high.z)};
}

// Lanes whose boxes are within reach of a box.
UVC_INLINE LaneMask within_reach(const Bounds &bounds, Range box) {
    LaneVec below = load_columns(bounds.low) - repeat(box.high),
            beyond = repeat(box.low) - load_columns(bounds.high);
    LaneVec gap = {most(most(below.x, beyond.x), 0.0f), most(most(below.y, beyond.y), 0.0f),
                most(most(below.z, beyond.z), 0.0f)};
    return dot(gap, gap) < REACH * REACH;
}

Range range_of(const Bounds &bounds, int lane) { return {pick(bounds.low, lane), pick(bounds.high, lane)}; }

// Copies what bounds a tile.
void copy_lane(const Bounds &from, int lane, Bounds &to, int other) {
    put(to.low, other, pick(from.low, lane));
    put(to.high, other, pick(from.high, lane));
    put(to.axis, other, pick(from.axis, lane));
    to.spread[other] = from.spread[lane];
}

// Bounds of no tile: an empty box.
void close(Bounds &bounds, int lane) {
    Range none;
    put(bounds.low, lane, none.low);
    put(bounds.high, lane, none.high);
}

// Sets places and boxes of the tiles of a group. Returns the box around them.
Range place_group(const Sides &sides, int group, const Vec *corners, Walls &walls) {
    Range all;
    for (int lane = 0; lane < LANES; lane++) {
        Tile &tile = walls.tiles[LANES * group + lane];
        const int32_t *vertices = sides.vertices.data + LANES * (LANES * group + lane);
        Range box;
        for (int k = 0; k < LANES && vertices[k] >= 0; k++) {
            Vec place = corners[vertices[k]];
            put(tile.start, k, place);
            widen(box, place, place);
        }
        put(walls.bounds[group].low, lane, box.low);
        put(walls.bounds[group].high, lane, box.high);
        widen(all, box.low, box.high);
    }
    return all;
}

// Marks the tiles of a side and of the next one that are within reach of each other.
void mark_near(const Sides &sides, int side, Range next, Walls &walls) {
    int middle = sides.starts[side + 1], end = sides.starts[side + 2];
    for (int group = sides.starts[side]; group < middle; group++) {
        for (unsigned left = bits(within_reach(walls.bounds[group], next)); left; left &= left - 1) {
            int lane = __builtin_ctz((unsigned)left);
            Range box = range_of(walls.bounds[group], lane);
            for (int other = middle; other < end; other++) {
                int near = bits(within_reach(walls.bounds[other], box));
                walls.near[other] |= near;
                if (near) walls.near[group] |= 1 << lane;
            }
        }
    }
}

Vec outward(const Sides &sides, int vertex, const Vec *corners) {
    Vec point = corners[vertex], normal{};
    for (int k = sides.ring_starts[vertex]; k < sides.ring_starts[vertex + 1]; k++)
        normal += cross(corners[sides.rings[2 * k]] - point, corners[sides.rings[2 * k + 1]] - point);
    return (1.0f / most(length(normal), 1e-12f)) * normal;
}

// Sets normals of a tile, and what bounds them.
void turn_tile(const Sides &sides, int index, const Vec *corners, Walls &walls) {
    Tile &tile = walls.tiles[index];
    Bounds &bounds = walls.bounds[index / LANES];
    const int32_t *vertices = sides.vertices.data + LANES * index;
    memcpy(tile.place, tile.start, sizeof(tile.place));
    Vec total{};
    for (int k = 0; k < LANES && vertices[k] >= 0; k++) {
        Vec normal = outward(sides, vertices[k], corners);
        put(tile.normal, k, normal);
        total += normal;
    }
    Vec axis = unit(total);
    float spread = 0;
    for (int k = 0; k < LANES && vertices[k] >= 0; k++)
        spread = most(spread, length(pick(tile.normal, k) - axis));
    put(bounds.axis, index % LANES, axis);
    bounds.spread[index % LANES] = spread;
}

// Finds the other two corners of the faces around each vertex.
void find_rings(Array<Face> faces, int vertices, Sides &sides, Arena &arena) {
    Arena work;
    sides.ring_starts = arena.take<int32_t>(vertices + 1);
    sides.rings = arena.take<int32_t>(6 * faces.size);
    for (Face face : faces)
        for (int corner = 0; corner < 3; corner++) sides.ring_starts[face[corner] + 1]++;
    for (int k = 0; k < vertices; k++) sides.ring_starts[k + 1] += sides.ring_starts[k];
    Array<int32_t> ends = work.copy(sides.ring_starts);
    for (int corner = 0; corner < 3; corner++)
        for (Face face : faces) {
            int32_t *ring = sides.rings.data + 2 * ends[face[corner]]++;
            ring[0] = face[(corner + 1) % 3];
            ring[1] = face[(corner + 2) % 3];
        }
}

// Squared distance, m2, within which all points of a wall count alike: half of that between points.
float core_of(const Graph &graph, int vertex, float spacing) {
    int first = graph.starts[vertex], end = graph.starts[vertex + 1];
    float total = 0;
    for (int k = first; k < end; k++) total += graph.lengths[k];
    float half = 0.5f * most(total / (float)most(end - first, 1), spacing);
    return half * half;
}

}  // namespace

Sides read_sides(const Sections &sections, Array<Face> faces, const Graph &graph, Arena &arena,
                 Failure &failure) {
    Arena work;
    Sides sides{};
    int count = read_integers(sections, "opening.starts", -1, 1, work, failure).size - 1;
    sides.points = read_indices(sections, "opening.points", -1, 1, 0, graph.vertices(), arena, failure);
    int points = sides.points.size;
    if (!failure.failed && (count < 0 || count % 2)) failure.say("opening.starts is not of pairs of sides");
    if (count > MOST_SIDES)
        failure.say("opening.starts has %d sides, at most %d are possible", count, MOST_SIDES);
    Array<int32_t> firsts = read_starts(sections, "opening.starts", count, points, work, failure);
    float spacing = read_number(sections, "opening.spacing", failure);
    if (!failure.failed && !(spacing > 0)) failure.say("opening.spacing of the outfit has to be above zero");
    if (failure.failed) return {};
    find_rings(faces, graph.vertices(), sides, arena);
    constexpr int GROUP = LANES * LANES;
    sides.sides = count;
    sides.starts = arena.take<int32_t>(count + 1);
    for (int side = 0; side < count; side++)
        sides.starts[side + 1] = sides.starts[side] + (firsts[side + 1] - firsts[side] + GROUP - 1) / GROUP;
    sides.rows = arena.take<int32_t>(points);
    sides.vertices = arena.take<int32_t>(GROUP * sides.groups());
    sides.core = arena.take<float>(GROUP * sides.groups());
    for (int32_t &vertex : sides.vertices) vertex = -1;
    for (float &squared : sides.core) squared = 1;
    for (int side = 0; side < count; side++)
        for (int point = firsts[side]; point < firsts[side + 1]; point++) {
            int row = GROUP * sides.starts[side] + point - firsts[side];
            sides.rows[point] = row;
            sides.vertices[row] = sides.points[point];
            sides.core[row] = core_of(graph, sides.points[point], spacing);
        }
    return sides;
}

Walls make_walls(const Sides &sides, Arena &arena) {
    int groups = sides.groups(), tiles = LANES * groups;
    Walls walls{arena.take<Tile>(tiles), arena.take<Bounds>(groups), arena.take<int32_t>(groups),
                arena.take<OpposingTiles>(groups)};
    for (int tile = 0; tile < tiles; tile++)
        for (int k = 0; k < LANES; k++) {
            put(walls.tiles[tile].start, k, {FAR, FAR, FAR});
            walls.tiles[tile].core[k] = sides.core[LANES * tile + k];
        }
    return walls;
}

void raise_walls(const Sides &sides, const Vec *corners, Walls &walls) {
    for (int32_t &near : walls.near) near = 0;
    for (int side = 0; side < sides.sides; side += 2) {
        Range second;
        for (int group = sides.starts[side]; group < sides.starts[side + 2]; group++) {
            Range box = place_group(sides, group, corners, walls);
            if (group >= sides.starts[side + 1]) widen(second, box.low, box.high);
        }
        mark_near(sides, side, second, walls);
    }
    for (int group = 0; group < sides.groups(); group++)
        for (int lane = 0; lane < LANES; lane++)
            if (walls.near[group] >> lane & 1) turn_tile(sides, LANES * group + lane, corners, walls);
}

Array<OpposingTiles> find_facing(const Sides &sides, Walls &walls, int side, int tile) {
    const Bounds &own = walls.bounds[tile / LANES];
    Range box = range_of(own, tile % LANES);
    LaneVec axis = repeat(pick(own.axis, tile % LANES));
    float spread = own.spread[tile % LANES];
    int other = side ^ 1, count = 0;
    for (int group = sides.starts[other]; group < sides.starts[other + 1]; group++) {
        const Bounds &bounds = walls.bounds[group];
        // The least cosine between two normals that differ by no more than the spreads from the axes.
        Lanes others = load(bounds.spread), cosine = dot(axis, load_columns(bounds.axis)) - spread;
        LaneMask faces = cosine - (1.0f + spread) * others < FACING;
        for (unsigned left = bits(within_reach(bounds, box) & faces); left; left &= left - 1) {
            int lane = __builtin_ctz((unsigned)left);
            OpposingTiles &facing = walls.facing[count / LANES];
            copy_lane(bounds, lane, facing.bounds, count % LANES);
            facing.tiles[count++ % LANES] = LANES * group + lane;
        }
    }
    int blocks = (count + LANES - 1) / LANES;
    for (; count % LANES; count++) close(walls.facing[blocks - 1].bounds, count % LANES);
    return walls.facing.part(0, blocks);
}

Measured measure(const Walls &walls, int row, Array<OpposingTiles> facing) {
    constexpr float SQUARE = REACH * REACH;
    const Tile &own = walls.tiles[row / LANES];
    int lane = row % LANES;
    Vec point = pick(own.start, lane);
    LaneVec start = repeat(point), place = repeat(pick(own.place, lane)),
            normal = repeat(pick(own.normal, lane));
    LaneVec wall{}, way{};
    Lanes weight{}, above{};
    for (const OpposingTiles &few : facing) {
        LaneMask faces = dot(normal, load_columns(few.bounds.axis)) - load(few.bounds.spread) < FACING;
        for (unsigned left = bits(within_reach(few.bounds, {point, point}) & faces); left; left &= left - 1) {
            const Tile &tile = walls.tiles[few.tiles[__builtin_ctz((unsigned)left)]];
            LaneVec at_start = start - load_columns(tile.start), away = place - load_columns(tile.place);
            LaneVec other = load_columns(tile.normal);
            Lanes square = dot(away, away), rest = 1.0f - (1.0f / SQUARE) * square;
            Lanes against = (1.0f / (1.0f + FACING)) * (FACING - dot(normal, other));
            LaneMask counts = is_below(dot(at_start, at_start), Lanes{} + SQUARE) & is_below(Lanes{}, rest) &
                              is_below(Lanes{}, against);
            Lanes share = against * (rest / (square + 0.5f * (own.core[lane] + load(tile.core))));
            share = choose(counts, share * share, Lanes{});
            LaneVec plane = share * other;
            weight += share;
            above += dot(away, plane);
            wall += plane;
            way += share * away;
        }
    }
    return {sum(weight), sum(above), sum(wall), sum(way)};
}

float lateral_distance(const Measured &measured) {
    float share = 1.0f / measured.weight;
    Vec wall = share * measured.wall, way = share * measured.way;
    return length(cross(way, wall)) / most(length(wall), 1e-12f);
}

void measure_all(const Sides &sides, const Vec *corners, float *distances) {
    Arena work;
    Walls walls = make_walls(sides, work);
    raise_walls(sides, corners, walls);
    Array<OpposingTiles> facing;
    int side = 0, tile = -1;
    for (int point = 0; point < sides.points.size; point++) {
        int row = sides.rows[point];
        distances[point] = FAR;
        if (!(walls.near[row / LANES / LANES] >> row / LANES % LANES & 1)) continue;
        while (row / LANES / LANES >= sides.starts[side + 1]) side++;
        if (row / LANES != tile) {
            tile = row / LANES;
            facing = find_facing(sides, walls, side, tile);
        }
        Measured measured = measure(walls, row, facing);
        if (measured.weight > 0) distances[point] = measured.distance();
    }
}

}  // namespace uvc
