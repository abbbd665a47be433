// The C interface of clearing.
#include "clearing.h"
#include "uvcloth.h"

struct uvc_clearing {
    uvc::Clearing data;
};

extern "C" {

uvc_clearing *uvc_read_clearing(const void *bytes, size_t size, char *message, size_t room) {
    auto read = [](const uvc::Sections &sections, uvc_clearing &object, uvc::Failure &failure) {
        uvc::read_clearing(sections, object.data, failure);
    };
    return uvc::read_object<uvc_clearing>(bytes, size, message, room, read);
}

void uvc_free_clearing(uvc_clearing *clearing) { uvc::drop(clearing); }

size_t uvc_clearing_memory(const uvc_clearing *clearing) {
    return uvc::memory_size(clearing->data);
}

void uvc_begin_clearing(const uvc_clearing *clearing, void *memory) {
    uvc::begin(clearing->data, uvc::lay_out(clearing->data, memory));
}

void uvc_clear(const uvc_clearing *clearing, void *memory, float *cloth, const float *collider,
               float clearance, float reach) {
    uvc::Arena work;
    uvc::ClearingMemory views = uvc::lay_out(clearing->data, memory);
    uvc::clear_skin(clearing->data, views, reinterpret_cast<uvc::Vec *>(cloth),
                    reinterpret_cast<const uvc::Vec *>(collider), clearance, reach, work);
}

void uvc_cover(const uvc_clearing *clearing, float *cloth, const float *skin) {
    uvc::Arena work;
    uvc::cover_skin(clearing->data, reinterpret_cast<uvc::Vec *>(cloth),
                    reinterpret_cast<const uvc::Vec *>(skin), work);
}

void uvc_lift(const uvc_clearing *clearing, float *cloth, float clearance, int turns) {
    uvc::Arena work;
    uvc::lift(clearing->data.layers, clearing->data.rings, {}, reinterpret_cast<uvc::Vec *>(cloth), clearance,
              turns, work);
}

}  // extern "C"
