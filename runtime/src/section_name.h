// Names of sections that several things have: a prefix and an end.
#pragma once

#include <stddef.h>

namespace uvc {

struct SectionName {
    char text[32];

    SectionName(const char *prefix, const char *end) {
        const char *parts[] = {prefix, end};
        size_t size = 0;
        for (const char *part : parts)
            for (; *part && size + 1 < sizeof(text); part++) text[size++] = *part;
        text[size] = 0;
    }
};

}  // namespace uvc
