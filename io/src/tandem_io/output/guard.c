/* SPDX-License-Identifier: MIT */
/* Protection of a result file beyond HDF5: a lock while it is written, checks that it still exists and that the disk has room,
   an end ahead of the written data, and the system's reason if it refuses to write. */
#define _GNU_SOURCE
#include "superblock.h"
#include <errno.h>
#include <fcntl.h>
#include <stdint.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

/* A descriptor of the file with a shared lock: readers may come, no other writer may. -1 if it cannot be opened. No lock on
   file systems without locks. */
int tandem_guard_take(const char *path)
{
    int file = open(path, O_RDWR | O_CLOEXEC | O_NONBLOCK);

    if (file >= 0)
        flock(file, LOCK_SH | LOCK_NB);
    return file;
}

/* A descriptor of the file that no other process can get meanwhile, until it is released; -2 if another one has it, -1 if the file
   cannot be opened. The lock is on a byte far behind the end, so that it hinders no reader. A file system without locks has
   none. */
int tandem_guard_claim(const char *path)
{
    int file = open(path, O_RDWR | O_CLOEXEC | O_NONBLOCK);
#ifdef F_OFD_SETLK
    struct flock lock = {.l_type = F_WRLCK, .l_whence = SEEK_SET, .l_start = INT64_MAX - 1, .l_len = 1};

    if (file >= 0 && fcntl(file, F_OFD_SETLK, &lock) != 0 && (errno == EAGAIN || errno == EACCES)) {
        close(file);
        return -2;
    }
#endif
    return file;
}

void tandem_guard_release(int file)
{
    close(file);
}

/* True if another process has locked the file. */
int tandem_guard_is_taken(const char *path)
{
    int file = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK), is_taken;

    if (file < 0)
        return 0;
    is_taken = flock(file, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK;
    close(file);
    return is_taken;
}

/* True if the path still leads to the file. */
int tandem_guard_is_there(int file, const char *path)
{
    struct stat ours, theirs;

    return fstat(file, &ours) == 0 && stat(path, &theirs) == 0 && ours.st_dev == theirs.st_dev && ours.st_ino == theirs.st_ino;
}

/* Read the superblock, the end of the file stated there, and the size of the file. 0 if the superblock is unknown. */
static int read_superblock(int file, unsigned char *bytes, uint64_t *last, uint64_t *size)
{
    struct stat about;

    if (pread(file, bytes, superblock_size, 0) != superblock_size || fstat(file, &about) != 0 || !tandem_superblock_is_known(bytes))
        return 0;
    *last = tandem_superblock_end(bytes);
    *size = (uint64_t)about.st_size;
    return 1;
}

/* True if the file is signed as HDF5 and not shorter than a known superblock states; files written here always are (driver.c). */
int tandem_guard_is_whole(int file)
{
    unsigned char bytes[superblock_size];
    struct stat about;

    return pread(file, bytes, superblock_size, 0) == superblock_size && fstat(file, &about) == 0 &&
           tandem_superblock_is_signed(bytes) &&
           (!tandem_superblock_is_known(bytes) || tandem_superblock_end(bytes) <= (uint64_t)about.st_size);
}

/* Remove the mark of a writer from the superblock, and let the file end where it says, or at `end` if that is later: before a
   flush, so that flushed data never lie behind the end. An unknown superblock is left alone. */
void tandem_guard_mend(int file, int64_t end)
{
    unsigned char bytes[superblock_size];
    uint64_t last, size;

    if (!read_superblock(file, bytes, &last, &size) ||
        (!tandem_superblock_is_marked(bytes) && end <= (int64_t)last && last <= size))
        return;
    if (end > (int64_t)last)
        last = (uint64_t)end;
    if (last > size && ftruncate(file, (off_t)last) != 0)
        last = size;
    tandem_superblock_set(bytes, last);
    /* A failure leaves the mark, with which the file can be read by those who ask for it (SWMR). */
    if (pwrite(file, bytes, superblock_size, 0) != superblock_size)
        return;
}

/* Cut the file at the end stated in the superblock: beyond it lies unused room for rows. */
void tandem_guard_trim(int file)
{
    unsigned char bytes[superblock_size];
    uint64_t last, size;

    if (!read_superblock(file, bytes, &last, &size) || last >= size)
        return;
    /* A failure leaves unused room. */
    if (ftruncate(file, (off_t)last) != 0)
        return;
}

/* True if the file may grow by so many bytes; its length stays unchanged. */
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
