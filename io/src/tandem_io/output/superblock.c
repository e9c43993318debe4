/* SPDX-License-Identifier: MIT */
#include "superblock.h"
#include <string.h>

/* Offsets of the version, the sizes of addresses and lengths, the marks, the end of the file and the checksum. */
enum { version_at = 8, sizes_at = 9, marks_at = 11, end_at = 28, checksum_at = 44 };

static uint32_t rotate(uint32_t x, int bits)
{
    return x << bits | x >> (32 - bits);
}

/* Bob Jenkins' hash lookup3 (public domain) of the 44 bytes before the checksum, as used by HDF5 for metadata. */
static uint32_t checksum(const unsigned char *bytes)
{
    uint32_t word[12] = {0}, a, b, c;

    for (int i = 0; i < checksum_at; i++)
        word[i / 4] |= (uint32_t)bytes[i] << 8 * (i % 4);
    a = b = c = 0xdeadbeefu + checksum_at;
    for (int i = 0; i < 9; i += 3) {
        a += word[i], b += word[i + 1], c += word[i + 2];
        a -= c, a ^= rotate(c, 4), c += b;
        b -= a, b ^= rotate(a, 6), a += c;
        c -= b, c ^= rotate(b, 8), b += a;
        a -= c, a ^= rotate(c, 16), c += b;
        b -= a, b ^= rotate(a, 19), a += c;
        c -= b, c ^= rotate(b, 4), b += a;
    }
    a += word[9], b += word[10], c += word[11];
    c ^= b, c -= rotate(b, 14);
    a ^= c, a -= rotate(c, 11);
    b ^= a, b -= rotate(a, 25);
    c ^= b, c -= rotate(b, 16);
    a ^= c, a -= rotate(c, 4);
    b ^= a, b -= rotate(a, 14);
    c ^= b, c -= rotate(b, 24);
    return c;
}

static uint64_t number_at(const unsigned char *bytes, int size)
{
    uint64_t number = 0;

    for (int i = 0; i < size; i++)
        number |= (uint64_t)bytes[i] << 8 * i;
    return number;
}

static void put_number(unsigned char *bytes, int size, uint64_t number)
{
    for (int i = 0; i < size; i++)
        bytes[i] = (unsigned char)(number >> 8 * i);
}

int tandem_superblock_is_signed(const unsigned char *bytes)
{
    static const unsigned char signature[8] = {0x89, 'H', 'D', 'F', '\r', '\n', 0x1a, '\n'};

    return memcmp(bytes, signature, sizeof signature) == 0;
}

int tandem_superblock_is_known(const unsigned char *bytes)
{
    return tandem_superblock_is_signed(bytes) && bytes[version_at] == 3 && bytes[sizes_at] == 8 &&
           bytes[sizes_at + 1] == 8 && number_at(bytes + checksum_at, 4) == checksum(bytes);
}

uint64_t tandem_superblock_end(const unsigned char *bytes)
{
    return number_at(bytes + end_at, 8);
}

int tandem_superblock_is_marked(const unsigned char *bytes)
{
    return bytes[marks_at] != 0;
}

void tandem_superblock_set(unsigned char *bytes, uint64_t end)
{
    bytes[marks_at] = 0;
    put_number(bytes + end_at, 8, end);
    put_number(bytes + checksum_at, 4, checksum(bytes));
}
