// Arrays, and the arenas that their memory comes from and goes back to as a whole.
#pragma once

#include <stdlib.h>
#include <string.h>

#if defined(__SANITIZE_ADDRESS__)
#include <sanitizer/asan_interface.h>
#endif

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

template <class T> UVC_INLINE void swap(Array<T> &a, Array<T> &b) {
    Array<T> other = a;
    a = b;
    b = other;
}

// Memory that is taken piece by piece and given back at once. Pieces are aligned to 64 bytes.
class Arena {
  public:
    Arena() = default;
    Arena(const Arena &) = delete;
    ~Arena() {
        while (first_) {
            Block *next = first_->next;
            free(first_);
            first_ = next;
        }
    }

    // Takes an array of `count` zeroed items. Where the system has no memory left the process ends.
    template <class T> Array<T> take(int count) {
        Array<T> array = room<T>(count);
        memset(static_cast<void *>(array.data), 0, sizeof(T) * (size_t)array.size);
        return array;
    }

    // Takes an array of `count` items that are not zeroed.
    template <class T> Array<T> room(int count) {
        return {static_cast<T *>(piece(sizeof(T) * (size_t)(count > 0 ? count : 0))), count > 0 ? count : 0};
    }

    template <class T> Array<T> copy(const T *data, int count) {
        Array<T> array = room<T>(count);
        if (count > 0) memcpy(array.data, data, sizeof(T) * (size_t)count);
        return array;
    }

    template <class T> Array<T> copy(Array<T> array) { return copy(array.data, array.size); }

    // Gives all pieces back, and keeps the memory for those that are taken next.
    void clear() {
        block_ = nullptr;
        used_ = 0;
    }

  private:
    friend class Scope;

    // A piece of the system's memory: `size` bytes follow it, from a multiple of ALIGNED on.
    struct Block {
        Block *next;
        size_t size;
        char *start() { return (char *)(((uintptr_t)(this + 1) + ALIGNED - 1) & ~(uintptr_t)(ALIGNED - 1)); }
    };
    static constexpr size_t ALIGNED = 64, LEAST = 1 << 16;
#if defined(__SANITIZE_ADDRESS__)
    // Between pieces, so that access beyond one is seen.
    static constexpr size_t GAP = 64;
#else
    static constexpr size_t GAP = 0;
#endif

    void *piece(size_t asked) {
        size_t size = (asked + GAP + ALIGNED - 1) & ~(ALIGNED - 1);
        while (!block_ || block_->size - used_ < size) {
            Block *&next = block_ ? block_->next : first_;
            if (!next) next = new_block(size > LEAST ? size : LEAST);
            block_ = next;
            used_ = 0;
        }
        char *start = block_->start() + used_;
        used_ += size;
#if defined(__SANITIZE_ADDRESS__)
        __asan_unpoison_memory_region(start, asked);
        __asan_poison_memory_region(start + asked, size - asked);
#endif
        return start;
    }

    static Block *new_block(size_t size) {
        Block *block = static_cast<Block *>(malloc(sizeof(Block) + size + ALIGNED));
        if (!block) __builtin_trap();
        *block = {nullptr, size};
        return block;
    }

    Block *first_ = nullptr, *block_ = nullptr;
    size_t used_ = 0;
};

// Gives back what is taken from an arena in its lifetime; the arena keeps the memory for what is taken next.
class Scope {
  public:
    explicit Scope(Arena &arena) : arena_(arena), block_(arena.block_), used_(arena.used_) {}
    Scope(const Scope &) = delete;
    ~Scope() {
        arena_.block_ = block_;
        arena_.used_ = used_;
    }

  private:
    Arena &arena_;
    Arena::Block *block_;
    size_t used_;
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
