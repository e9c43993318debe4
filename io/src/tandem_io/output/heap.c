/* SPDX-License-Identifier: MIT */
#include "heap.h"
#include <string.h>

/* The least size of a collection; the sizes of its header, of an object's header, and of a reference to a dataset; and where the
   length of the collection and of an object stand. */
enum { least = 4096, head = 16, object_head = 16, reference = 8, length_at = 8 };

static uint64_t number_at(const unsigned char *bytes, int size)
{
    uint64_t number = 0;

    for (int i = 0; i < size; i++)
        number |= (uint64_t)bytes[i] << 8 * i;
    return number;
}

uint64_t tandem_heap_length(const unsigned char *bytes, size_t size)
{
    static const unsigned char signature[8] = {'G', 'C', 'O', 'L', 1, 0, 0, 0};

    /* As a number these bytes are 2.6e-314, which does not occur in rows of a run. */
    return size < least || memcmp(bytes, signature, sizeof signature) != 0 ? 0 : number_at(bytes + length_at, 8);
}

int tandem_heap_is_sound(const unsigned char *bytes, uint64_t end)
{
    uint64_t length, at = head;

    if (end < least)
        return 0;
    /* A remainder too small for an object's header is free. */
    while (at + object_head <= end) {
        length = number_at(bytes + at + length_at, 8);
        /* Free space has the number 0 and comes last, with its header. */
        if (number_at(bytes + at, 2) == 0)
            return length == end - at;
        at += object_head;
        if (length > end - at)
            return 0;
        /* A text; its length is right if no letter is missing, which would be 0 here. */
        if (length != reference && memchr(bytes + at, 0, (size_t)length) != NULL)
            return 0;
        at += (length + 7) / 8 * 8;
        if (at > end)
            return 0;
    }
    return 1;
}
