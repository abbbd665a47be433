// Lists that grow.
#pragma once

#include "memory.h"

namespace uvc {

// Rows that grow. Memory is given back with the list.
template <class T> struct List {
    Array<T> items;
    int room = 0;

    List() = default;
    List(const List &) = delete;
    ~List() { free(items.data); }
    void clear() { items.size = 0; }
    void add(T item) {
        if (items.size == room) {
            room = most(2 * room, 256);
            items.data = static_cast<T *>(realloc(items.data, sizeof(T) * (size_t)room));
            if (!items.data) __builtin_trap();
        }
        items.data[items.size++] = item;
    }
    void assign(Array<T> others) {
        clear();
        for (const T &item : others) add(item);
    }
};

template <class T> void swap(List<T> &a, List<T> &b) {
    Array<T> items = a.items;
    int room = a.room;
    a.items = b.items;
    a.room = b.room;
    b.items = items;
    b.room = room;
}

}  // namespace uvc
