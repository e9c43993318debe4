/* SPDX-License-Identifier: MIT */
/* The superblock at the beginning of an HDF5 file: version 3, with addresses and lengths of 8 bytes (HDF5 File Format
   Specification, III.A). */
#ifndef TANDEM_SUPERBLOCK_H
#define TANDEM_SUPERBLOCK_H
#include <stdint.h>

enum { superblock_size = 48 };

/* True if the bytes are an undamaged superblock of this version. */
int tandem_superblock_is_known(const unsigned char *bytes);

/* True if the bytes begin with the signature of HDF5. */
int tandem_superblock_is_signed(const unsigned char *bytes);

/* End of the file stated in its superblock. */
uint64_t tandem_superblock_end(const unsigned char *bytes);

/* True if the superblock has the mark "open for writing". */
int tandem_superblock_is_marked(const unsigned char *bytes);

/* Remove the mark "open for writing", and set the stated end of the file. */
void tandem_superblock_set(unsigned char *bytes, uint64_t end);
#endif
