// The C interface of characters in baked outfits.
#include "character.h"

struct uvc_outfit {
    uvc::Outfit data;
};

struct uvc_cloth {
    uvc::Character data;

    explicit uvc_cloth(const uvc::Outfit &outfit) : data(outfit) {}
};

namespace uvc {

namespace {

// Joints (J, 3, 4) as turns and shifts.
Array<RigidTransform> rigid(const double *joints, int count, Arena &arena) {
    Array<RigidTransform> transforms = arena.take<RigidTransform>(count);
    for (int k = 0; k < count; k++) {
        const double *row = joints + 12 * k;
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++) transforms[k].turn.at[i][j] = row[4 * i + j];
        transforms[k].shift = {row[3], row[7], row[11]};
    }
    return transforms;
}

}  // namespace

}  // namespace uvc

extern "C" {

uvc_outfit *uvc_read(const void *bytes, size_t size, char *message, size_t room) {
    auto read = [](const uvc::Sections &sections, uvc_outfit &object, uvc::Failure &failure) {
        uvc::read_outfit(sections, object.data, failure);
    };
    return uvc::read_object<uvc_outfit>(bytes, size, message, room, read);
}

void uvc_free(uvc_outfit *outfit) { uvc::drop(outfit); }

int uvc_joints(const uvc_outfit *outfit) { return outfit->data.skeleton.parents.size; }

int uvc_garments(const uvc_outfit *outfit) { return outfit->data.garments(); }

int uvc_garment_vertices(const uvc_outfit *outfit, int garment) {
    return outfit->data.vertices(garment);
}

uvc_cloth *uvc_new(const uvc_outfit *outfit) { return uvc::make<uvc_cloth>(outfit->data); }

void uvc_drop(uvc_cloth *cloth) { uvc::drop(cloth); }

int uvc_start(uvc_cloth *cloth, const double *joints, char *message, size_t room) {
    uvc::Failure failure{message, room};
    uvc::Arena &work = cloth->data.scratch;
    uvc::Scope scope(work);
    int count = cloth->data.outfit.skeleton.parents.size;
    return uvc::start(cloth->data, uvc::rigid(joints, count, work).data, failure);
}

int uvc_step(uvc_cloth *cloth, const double *joints, double seconds, char *message, size_t room) {
    uvc::Failure failure{message, room};
    uvc::Arena &work = cloth->data.scratch;
    uvc::Scope scope(work);
    int count = cloth->data.outfit.skeleton.parents.size;
    return uvc::step(cloth->data, uvc::rigid(joints, count, work).data, (float)seconds, failure);
}

int uvc_cages(const uvc_outfit *outfit) { return outfit->data.cages.vertices(); }

int uvc_cage_faces(const uvc_outfit *outfit) { return outfit->data.solver.mesh.surface.faces.size; }

void uvc_cage_corners(const uvc_outfit *outfit, int32_t *corners) {
    uvc::Array<uvc::Face> faces = outfit->data.solver.mesh.surface.faces;
    memcpy(corners, faces.data, sizeof(uvc::Face) * (size_t)faces.size);
}

void uvc_pull(uvc_cloth *cloth, const double *points, double rate) {
    uvc::pull(cloth->data, reinterpret_cast<const uvc::Vec64 *>(points), (float)rate);
}

int uvc_set_world(uvc_cloth *cloth, const double *wind, const double *gravity, char *message, size_t room) {
    uvc::Failure failure{message, room};
    return uvc::set_world(cloth->data, {wind[0], wind[1], wind[2]}, {gravity[0], gravity[1], gravity[2]},
                          failure);
}

int uvc_set_fabric(uvc_cloth *cloth, int garment, double density, double stretch, double bend, char *message,
                   size_t room) {
    uvc::Failure failure{message, room};
    return uvc::set_fabric(cloth->data, garment, {(float)density, (float)stretch, (float)bend}, failure);
}

size_t uvc_saved_size(const uvc_cloth *cloth) { return uvc::saved_size(cloth->data); }

void uvc_save(const uvc_cloth *cloth, void *bytes) { uvc::save(cloth->data, static_cast<uint8_t *>(bytes)); }

int uvc_restore(uvc_cloth *cloth, const void *bytes, size_t size) {
    return uvc::restore(cloth->data, static_cast<const uint8_t *>(bytes), size);
}

void uvc_cage_vertices(const uvc_cloth *cloth, double *vertices) {
    const uvc::Character &character = cloth->data;
    uvc::Vec64 *places = reinterpret_cast<uvc::Vec64 *>(vertices);
    for (int k = 0; k < character.positions.size; k++)
        places[k] = uvc::wide(character.positions[k]) + character.origin;
    uvc::bring_back(character.place, places, character.positions.size);
}

void uvc_vertices(const uvc_cloth *cloth, int garment, double *vertices) {
    const uvc::Character &character = cloth->data;
    const uvc::Outfit &outfit = character.outfit;
    int first = outfit.shown_starts[garment], count = outfit.vertices(garment);
    const uvc::WrinkledGarment *folded = outfit.wrinkled(garment);
    uvc::Vec64 *places = reinterpret_cast<uvc::Vec64 *>(vertices);
    for (int k = 0; k < count; k++) {
        uvc::Vec place = folded ? character.wrinkled[folded->vertices + k]
                                : character.shown[outfit.shown[first + k]];
        places[k] = uvc::wide(place) + character.shown_origin;
    }
    uvc::bring_back(character.place, places, count);
}

}  // extern "C"
