/* SPDX-License-Identifier: MIT */
/* Collections of texts in an HDF5 file (HDF5 File Format Specification, III.E, "Global Heap"). */
#ifndef TANDEM_HEAP_H
#define TANDEM_HEAP_H
#include <stddef.h>
#include <stdint.h>

/* The length of a collection that begins with some bytes of a file, by what it says; 0 if they are none. */
uint64_t tandem_heap_length(const unsigned char *bytes, size_t size);

/* True if HDF5 can read a collection. Collections have no checksum; HDF5 1.10 uses all lengths in them unchecked, and writes beyond
   its memory if they are damaged. */
int tandem_heap_is_sound(const unsigned char *bytes, uint64_t length);
#endif
