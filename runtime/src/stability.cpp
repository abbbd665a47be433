#include "stability.h"

namespace uvc {

namespace {

// Power iterations: the eigenvalue is found to about a percent.
constexpr int ITERATIONS = 60;

// Metres, or m/s, by which a vertex is moved at most where forces are compared.
constexpr double DISPLACEMENT = 2e-4, SPEED = 1;

double length(Array<Vec64> vectors) {
    double squared = 0;
    for (Vec64 vector : vectors) squared += dot(vector, vector);
    return __builtin_sqrt(squared);
}

// Directions that no symmetry of a mesh shares, the same ones every time.
void fill(Array<Vec64> vectors) {
    uint64_t state = 1;
    auto next = [&] {
        state = state * 6364136223846793005ull + 1442695040888963407ull;
        return (double)(state >> 33) / (double)(1ull << 30) - 1.0;
    };
    for (Vec64 &vector : vectors) vector = {next(), next(), next()};
}

// Largest eigenvalue of the mass-weighted stiffness, 1/s2, or of the damping, 1/s.
double largest_eigenvalue(const Elastic &elastic, Array<float> mass, Array<Vec> rest, bool of_rates,
                          Arena &work) {
    int vertices = rest.size;
    Array<Vec64> direction = work.take<Vec64>(vertices);
    Array<Row> rows = work.take<Row>(vertices);
    Array<Force> forces = work.take<Force>(vertices);
    fill(direction);
    double value = 0;
    for (int iteration = 0; iteration < ITERATIONS; iteration++) {
        double shorter = 1 / length(direction), most_squared = 0;
        for (int k = 0; k < vertices; k++) {
            direction[k] = shorter * direction[k];
            double squared = dot(direction[k], direction[k]) / mass[k];
            most_squared = squared > most_squared ? squared : most_squared;
        }
        double size = (of_rates ? SPEED : DISPLACEMENT) / __builtin_sqrt(most_squared);
        for (Force &force : forces) force = Force{};
        // Forces at the far side are taken from those at the near side.
        const double signs[] = {-1, 1};
        for (double sign : signs) {
            for (int k = 0; k < vertices; k++) {
                Vec shift = narrow(sign * size / __builtin_sqrt((double)mass[k]) * direction[k]), x = rest[k],
                    v{};
                if (of_rates)
                    v = shift;
                else
                    x += shift;
                rows[k] = {{x.x, x.y, x.z, 0, v.x, v.y, v.z, 0}};
                forces[k] = -forces[k];
            }
            add_membrane_forces(elastic.membrane, rows.data, {}, forces.data);
            add_hinge_forces(elastic.hinges, rows.data, 1, forces.data);
        }
        for (int k = 0; k < vertices; k++) {
            double share = -1 / (2 * size * __builtin_sqrt((double)mass[k]));
            Force force = forces[k];
            direction[k] = share * Vec64{force[0], force[1], force[2]};
        }
        value = length(direction);
        if (!(value > 0)) break;
    }
    return value;
}

}  // namespace

float stable_step(const Elastic &elastic, Array<float> mass, const Vec *rest, Arena &work) {
    Scope scope(work);
    Elastic still = elastic;
    // In tension cloth is as stiff as it gets, however soft compression is.
    still.membrane.reduction = 1;
    still.membrane.pressure = work.take<float>(elastic.membrane.pressure.size);
    Array<Vec> centred = work.copy(rest, mass.size);
    Vec64 middle{};
    for (Vec point : centred) middle += (1.0 / mass.size) * wide(point);
    for (Vec &point : centred) point = narrow(wide(point) - middle);
    double damping = largest_eigenvalue(still, mass, centred, true, work);
    still.membrane.damping = still.membrane.pressure;
    still.hinges.damping = 0;
    double stiffness = largest_eigenvalue(still, mass, centred, false, work);
    return (float)((__builtin_sqrt(damping * damping + 4 * stiffness) - damping) / stiffness);
}

}  // namespace uvc
