/* SPDX-License-Identifier: MIT */
#include "heap.h"
#include <string.h>

/* Smallest size of a collection; sizes of the header of a collection, of the header of an object, and of a reference to a dataset;
   offset of the length in both headers. */
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

    /* Rows are not mistaken for a collection: as a real number the signature is 2.6e-314, which does not occur in runs. */
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
        /* An object that is not a reference is a text. Texts have no null: a null shows that the length is wrong. */
        if (length != reference && memchr(bytes + at, 0, (size_t)length) != NULL)
            return 0;
        at += (length + 7) / 8 * 8;
        if (at > end)
            return 0;
    }
    return 1;
}
