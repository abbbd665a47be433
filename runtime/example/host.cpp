// A host of the runtime, as an engine is one: a scene in its own axes and unit, joints that are nodes with
// parents, an animation of its own, and frames of uneven length. It writes what it would draw.
//
//     host HERO.cloth HERO.rig FRAMES FOLDER
//
// HERO.rig, which write_rig.py makes, is what an engine's importer knows of the baked file. FOLDER gets
// GARMENT_FRAME.obj, in the axes and the unit of the scene, and nodes.bin: seconds of each frame and the
// matrices of the nodes, doubles, so that another program can repeat it.
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <string>
#include <vector>

#include "matrix.h"
#include "uvcloth.h"

namespace {

struct Joint {
    std::string role;
    int parent;  // -1 for a root.
    Matrix local, inverse_bind;
};

struct Garment {
    std::string name;
    std::vector<int> vertices;   // The runtime's vertex of each vertex of the mesh.
    std::vector<int> triangles;  // Three vertices of the mesh each.
};

struct Rig {
    Matrix axes;  // From the scene to the runtime's world.
    std::vector<Joint> joints;
    std::vector<Garment> garments;
};

[[noreturn]] void fail(const std::string &sentence) {
    std::fprintf(stderr, "%s\n", sentence.c_str());
    std::exit(1);
}

std::vector<int> read_numbers(std::istream &file) {
    int count = 0;
    file >> count;
    std::vector<int> numbers(file ? count : 0);
    for (int &number : numbers) file >> number;
    return numbers;
}

Rig read_rig(const std::string &path) {
    std::ifstream file(path);
    Rig rig;
    int joints = 0, garments = 0;
    file >> rig.axes >> joints >> garments;
    for (int k = 0; file && k < joints; k++) {
        Joint joint;
        file >> joint.role >> joint.parent >> joint.local >> joint.inverse_bind;
        rig.joints.push_back(joint);
    }
    for (int k = 0; file && k < garments; k++) {
        Garment garment;
        file >> garment.name;
        garment.vertices = read_numbers(file);
        garment.triangles = read_numbers(file);
        rig.garments.push_back(garment);
    }
    if (!file) fail(path + ": is cut, or no rig");
    return rig;
}

// A turn of a joint about an axis of the scene in which it rests.
Matrix turned_at_rest(const Joint &joint, int axis, double degrees) {
    Matrix bind = joint.inverse_bind;
    for (int row = 0; row < 3; row++) bind.at[4 * row + 3] = 0;
    return bind * turn(axis, degrees) * inverse(bind);
}

// The animation: the character walks on a circle and twists its trunk. A parent comes before its children.
std::vector<Matrix> pose(const Rig &rig, double seconds) {
    double swing = std::sin(2 * PI * seconds);
    Matrix path = turn(1, 60 * seconds) * shift(1.5, 0, 0);
    std::vector<Matrix> worlds;
    for (const Joint &joint : rig.joints) {
        Matrix local = joint.local;
        if (joint.role == "LeftUpLeg") local = local * turned_at_rest(joint, 0, 25 * swing);
        if (joint.role == "RightUpLeg") local = local * turned_at_rest(joint, 0, -25 * swing);
        if (joint.role == "LowerBack") local = local * turned_at_rest(joint, 1, 8 * swing);
        bool is_root = joint.parent < 0;
        worlds.push_back((is_root ? path : worlds[(size_t)joint.parent]) * local);
    }
    return worlds;
}

// What the runtime takes of a pose: T = A W B inverse(A), without the last row.
std::vector<double> joint_transforms(const Rig &rig, const std::vector<Matrix> &worlds) {
    std::vector<double> numbers;
    for (size_t k = 0; k < worlds.size(); k++) {
        Matrix transform = rig.axes * worlds[k] * rig.joints[k].inverse_bind * inverse(rig.axes);
        numbers.insert(numbers.end(), transform.at, transform.at + 12);
    }
    return numbers;
}

// Draws a garment: here, writes it. Its mesh repeats vertices on seams of the texture, the runtime does not.
void draw(const Garment &garment, const Matrix &to_scene, const std::vector<double> &vertices,
          const std::string &path) {
    std::ofstream file(path);
    char line[128];
    for (int vertex : garment.vertices) {
        const double *at = &vertices[3 * (size_t)vertex];
        double point[3];
        to_scene.take(at, point);
        std::snprintf(line, sizeof line, "v %.9g %.9g %.9g\n", point[0], point[1], point[2]);
        file << line;
    }
    for (size_t k = 0; k + 2 < garment.triangles.size(); k += 3) {
        file << 'f';
        for (size_t corner = k; corner < k + 3; corner++) file << ' ' << garment.triangles[corner] + 1;
        file << '\n';
    }
    if (!file) fail(path + ": cannot be written");
}

std::vector<char> read_bytes(const std::string &path) {
    std::ifstream file(path, std::ios::binary);
    std::vector<char> bytes{std::istreambuf_iterator<char>(file), {}};
    if (bytes.empty()) fail(path + ": cannot be read");
    return bytes;
}

}  // namespace

int main(int count, char **arguments) {
    if (count != 5) fail("usage: host HERO.cloth HERO.rig FRAMES FOLDER");
    std::string folder = arguments[4];
    int frames = std::atoi(arguments[3]);
    char message[160];

    // Once, while the scene loads: an outfit serves any number of characters.
    std::vector<char> bytes = read_bytes(arguments[1]);
    uvc_outfit *outfit = uvc_read(bytes.data(), bytes.size(), message, sizeof message);
    if (!outfit) fail(std::string(arguments[1]) + ": " + message);
    Rig rig = read_rig(arguments[2]);
    if (uvc_joints(outfit) != (int)rig.joints.size() || uvc_garments(outfit) != (int)rig.garments.size())
        fail(std::string(arguments[2]) + ": is the rig of another file");

    // When a character appears. Starting takes as long as 65 frames.
    uvc_cloth *cloth = uvc_new(outfit);
    std::vector<double> first = joint_transforms(rig, pose(rig, 0));
    if (!uvc_start(cloth, first.data(), message, sizeof message)) fail(message);

    // Every frame, after the animation and before the skin is drawn.
    std::ofstream nodes(folder + "/nodes.bin", std::ios::binary);
    double now = 0, seconds = 1.0 / 30;
    for (int frame = 0; frame < frames; frame++) {
        std::vector<Matrix> worlds = pose(rig, now);
        std::vector<double> transforms = joint_transforms(rig, worlds);
        if (!uvc_step(cloth, transforms.data(), seconds, message, sizeof message))
            std::fprintf(stderr, "frame %d: %s\n", frame, message);  // The cloth stays as it was.
        nodes.write((const char *)&seconds, sizeof seconds);
        for (const Matrix &world : worlds) nodes.write((const char *)world.at, sizeof world.at);
        for (size_t k = 0; k < rig.garments.size(); k++) {
            std::vector<double> vertices(3 * (size_t)uvc_garment_vertices(outfit, (int)k));
            uvc_vertices(cloth, (int)k, vertices.data());
            std::string path = folder + "/" + rig.garments[k].name + "_" + std::to_string(frame) + ".obj";
            draw(rig.garments[k], inverse(rig.axes), vertices, path);
        }
        seconds = frame % 3 ? 1.0 / 60 : 1.0 / 40;  // As the clock of a busy machine goes.
        now += seconds;
    }
    if (!nodes) fail(folder + "/nodes.bin: cannot be written");
    uvc_drop(cloth);
    uvc_free(outfit);
    return 0;
}
