// Arrays, and the arenas that their memory comes from and goes back to as a whole.
#pragma once

#include <stdlib.h>
#include <string.h>

#include "vector.h"

// Makes an object in memory that is there already; its header belongs to the C++ standard library.
inline void *operator new(size_t, void *place) noexcept { return place; }

namespace uvc {

// View of `size` items in a row; it owns nothing.
template <class T> struct Array {
    T *data = nullptr;
    int size = 0;

    UVC_MEMBER T &at(int index) const { return data[index]; }
    T &operator[](int index) const { return data[index]; }
    T *begin() const { return data; }
    T *end() const { return data + size; }
    Array part(int first, int last) const { return {data + first, last - first}; }
};

// Memory that is taken piece by piece and given back at once. Pieces are zeroed and aligned to 64 bytes.
class Arena {
  public:
    Arena() = default;
    Arena(const Arena &) = delete;
    ~Arena() {
        while (last_) {
            Block *before = last_->before;
            free(last_);
            last_ = before;
        }
    }

    // Takes an array of `count` zeroed items. Where the system has no memory left the process ends.
    template <class T> Array<T> take(int count) {
        return {static_cast<T *>(bytes(sizeof(T) * (size_t)(count > 0 ? count : 0))), count > 0 ? count : 0};
    }

    template <class T> Array<T> copy(const T *data, int count) {
        Array<T> array = take<T>(count);
        if (count > 0) memcpy(array.data, data, sizeof(T) * (size_t)count);
        return array;
    }

    template <class T> Array<T> copy(Array<T> array) { return copy(array.data, array.size); }

  private:
    struct Block {
        Block *before;
    };

    void *bytes(size_t size) {
        char *raw = static_cast<char *>(calloc(1, size + 128));
        if (!raw) __builtin_trap();
        Block *block = reinterpret_cast<Block *>(raw);
        block->before = last_;
        last_ = block;
        return reinterpret_cast<void *>(((uintptr_t)raw + sizeof(Block) + 63) & ~(uintptr_t)63);
    }

    Block *last_ = nullptr;
};

// Makes an object of its own, and gives it back. Where the system has no memory left the process ends.
template <class T, class... Arguments> T *make(Arguments &...arguments) {
    void *place = calloc(1, sizeof(T));
    if (!place) __builtin_trap();
    return new (place) T{arguments...};
}

template <class T> void drop(T *object) {
    if (!object) return;
    object->~T();
    free(object);
}

// Sorts indices by `before(a, b)`, keeping the order of equals (merge sort, bottom up).
template <class T, class Before> void sort(Array<T> items, Before before) {
    Arena arena;
    Array<T> from = items, to = arena.take<T>(items.size);
    for (int width = 1; width < items.size; width *= 2) {
        for (int start = 0; start < items.size; start += 2 * width) {
            int middle = least(start + width, items.size), end = least(start + 2 * width, items.size);
            int a = start, b = middle;
            for (int k = start; k < end; k++)
                to[k] = a < middle && (b >= end || !before(from[b], from[a])) ? from[a++] : from[b++];
        }
        Array<T> swapped = from;
        from = to;
        to = swapped;
    }
    if (from.data != items.data && items.size) memcpy(items.data, from.data, sizeof(T) * (size_t)items.size);
}

}  // namespace uvc
