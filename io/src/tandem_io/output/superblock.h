/* SPDX-License-Identifier: MIT */
/* The first bytes of an HDF5 file, its superblock, as far as a file must know it that is whole at every moment: version 3, with
   addresses and lengths of 8 bytes (HDF5 File Format Specification, III.A). */
#ifndef TANDEM_SUPERBLOCK_H
#define TANDEM_SUPERBLOCK_H
#include <stdint.h>

enum { superblock_size = 48 };

/* True if the bytes are an undamaged superblock of that version. */
int tandem_superblock_is_known(const unsigned char *bytes);

/* True if a file that begins with the bytes is HDF5. */
int tandem_superblock_is_signed(const unsigned char *bytes);

/* End of the file stated in its superblock. */
uint64_t tandem_superblock_end(const unsigned char *bytes);

/* True if HDF5 has marked it as open for writing. */
int tandem_superblock_is_marked(const unsigned char *bytes);

/* Take that mark away, and let the file end there. */
void tandem_superblock_set(unsigned char *bytes, uint64_t end);
#endif
