/* SPDX-License-Identifier: MIT */
/* Collections of texts in an HDF5 file (HDF5 File Format Specification, III.E, "Global Heap"). */
#ifndef TANDEM_HEAP_H
#define TANDEM_HEAP_H
#include <stddef.h>
#include <stdint.h>

/* Length stated in the header of a collection; 0 if the bytes are not the beginning of a collection. */
uint64_t tandem_heap_length(const unsigned char *bytes, size_t size);

/* True if HDF5 can safely read a collection. Collections have no checksum, and HDF5 1.10 uses the lengths in them without checks:
   invalid lengths would make it write beyond its memory. */
int tandem_heap_is_sound(const unsigned char *bytes, uint64_t length);
#endif
