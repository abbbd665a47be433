// The C interface of wrinkles.
#include "uvcloth.h"
#include "wrinkles.h"

struct uvc_wrinkles {
    uvc::Wrinkles data;
    uvc::Arena arena;
};

extern "C" {

uvc_wrinkles *uvc_read_wrinkles(const void *bytes, size_t size, char *message, size_t room) {
    auto read = [](const uvc::Sections &sections, uvc_wrinkles &object, uvc::Failure &failure) {
        object.data = uvc::read_wrinkles(sections, object.arena, failure);
    };
    return uvc::read_object<uvc_wrinkles>(bytes, size, message, room, read);
}

void uvc_free_wrinkles(uvc_wrinkles *wrinkles) { uvc::drop(wrinkles); }

int uvc_wrinkled_vertices(const uvc_wrinkles *wrinkles) { return wrinkles->data.vertices; }

size_t uvc_wrinkle_memory(const uvc_wrinkles *wrinkles) { return uvc::memory_size(wrinkles->data); }

void uvc_begin_wrinkles(const uvc_wrinkles *wrinkles, void *memory) {
    uvc::begin(wrinkles->data, uvc::lay_out(wrinkles->data, memory));
}

void uvc_wrinkle(const uvc_wrinkles *wrinkles, void *memory, const float *points, const float *skin,
                 double seconds, float *vertices) {
    uvc::Arena work;
    uvc::WrinkleMemory views = uvc::lay_out(wrinkles->data, memory);
    uvc::wrinkle(wrinkles->data, views, reinterpret_cast<const uvc::Vec *>(points),
                 reinterpret_cast<const uvc::Vec *>(skin), (float)seconds, {},
                 reinterpret_cast<uvc::Vec *>(vertices), work);
}

}  // extern "C"
