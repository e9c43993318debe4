/* SPDX-License-Identifier: MIT */
/* What keeps a result file safe that HDF5 does not do: a lock while it is written, a look whether it is still there, and the
   removal of HDF5's mark "open for writing", which would keep plain readers out for ever once the writer was killed. */
#include <errno.h>
#include <fcntl.h>
#include <stdint.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

/* The superblock, version 3, with addresses of 8 bytes (HDF5 File Format Specification, III.A): where its version, the sizes of
   addresses and lengths, the marks, the end of the file and the checksum stand. */
enum { superblock = 48, version_at = 8, sizes_at = 9, marks_at = 11, end_at = 28, checksum_at = 44 };

static uint32_t rotate(uint32_t x, int bits)
{
    return x << bits | x >> (32 - bits);
}

/* Bob Jenkins' hash lookup3 (public domain) of the 44 bytes before the checksum, which HDF5 takes for metadata. */
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

/* A descriptor of the file with a shared lock: readers may come, no other writer may. -1 where it cannot be opened. A file system
   without locks has none. */
int tandem_guard_take(const char *path)
{
    int file = open(path, O_RDWR | O_CLOEXEC | O_NONBLOCK);

    if (file >= 0)
        flock(file, LOCK_SH | LOCK_NB);
    return file;
}

void tandem_guard_release(int file)
{
    close(file);
}

/* Whether another process has locked the file. */
int tandem_guard_is_taken(const char *path)
{
    int file = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK), is_taken;

    if (file < 0)
        return 0;
    is_taken = flock(file, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK;
    close(file);
    return is_taken;
}

/* Whether the path still leads to the file. */
int tandem_guard_is_there(int file, const char *path)
{
    struct stat ours, theirs;

    return fstat(file, &ours) == 0 && stat(path, &theirs) == 0 && ours.st_dev == theirs.st_dev && ours.st_ino == theirs.st_ino;
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

/* Read the superblock, where the file ends by it, and the size that the file has. 0 if it is none as we know it. */
static int read_superblock(int file, unsigned char *bytes, uint64_t *last, uint64_t *size)
{
    static const unsigned char signature[8] = {0x89, 'H', 'D', 'F', '\r', '\n', 0x1a, '\n'};
    struct stat about;

    if (pread(file, bytes, superblock, 0) != superblock || memcmp(bytes, signature, sizeof signature) != 0)
        return 0;
    if (bytes[version_at] != 3 || bytes[sizes_at] != 8 || bytes[sizes_at + 1] != 8 || fstat(file, &about) != 0)
        return 0;
    *last = number_at(bytes + end_at, 8);
    *size = (uint64_t)about.st_size;
    return number_at(bytes + checksum_at, 4) == checksum(bytes);
}

/* Remove the marks of a writer from the superblock, and let the file end where it says, or at `end` if that is later: before a
   flush, so that what the flush brings is never behind the end. What is no superblock as we know it is left alone. */
void tandem_guard_mend(int file, int64_t end)
{
    unsigned char bytes[superblock];
    uint64_t last, size;

    if (!read_superblock(file, bytes, &last, &size) || (bytes[marks_at] == 0 && end <= (int64_t)last && last <= size))
        return;
    bytes[marks_at] = 0;
    if (end > (int64_t)last)
        last = (uint64_t)end;
    if (last > size && ftruncate(file, (off_t)last) != 0)
        last = size;
    put_number(bytes + end_at, 8, last);
    put_number(bytes + checksum_at, 4, checksum(bytes));
    /* A failure leaves the mark, with which the file can be read by those who ask for it (SWMR). */
    if (pwrite(file, bytes, superblock, 0) != superblock)
        return;
}

/* Cut off what lies behind the end that the superblock states: room that was taken for rows and not used. */
void tandem_guard_trim(int file)
{
    unsigned char bytes[superblock];
    uint64_t last, size;

    if (!read_superblock(file, bytes, &last, &size) || last >= size)
        return;
    /* A failure leaves room that nobody looks at. */
    if (ftruncate(file, (off_t)last) != 0)
        return;
}

/* Whether the file may grow by so many bytes; it is left as it was. */
int tandem_guard_has_room(int file, int64_t bytes)
{
    struct stat about;
    int problem;

    if (fstat(file, &about) != 0)
        return 1;
    problem = posix_fallocate(file, about.st_size, (off_t)bytes);
    if (ftruncate(file, about.st_size) != 0 && problem == 0)
        problem = errno;
    errno = problem;
    return problem != ENOSPC && problem != EDQUOT && problem != EFBIG;
}

/* The system's words for its last refusal to write, if it was one: their length, 0 for none. */
int tandem_guard_reason(char *text, int size)
{
    static const int refusals[] = {ENOSPC, EDQUOT, EFBIG, EIO, EROFS, ENODEV, ESTALE, EACCES, EPERM};
    int problem = errno;

    for (size_t i = 0; i < sizeof refusals / sizeof *refusals; i++) {
        if (problem == refusals[i]) {
            const char *words = strerror(problem);
            size_t length = strlen(words);
            if (length > (size_t)size)
                length = (size_t)size;
            memcpy(text, words, length);
            return (int)length;
        }
    }
    return 0;
}

void tandem_guard_forget_reason(void)
{
    errno = 0;
}
