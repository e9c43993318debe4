/* SPDX-License-Identifier: MIT */
/* Protection of a result file in addition to HDF5: locks, checks that the file still exists and that the disk has space, a stated
   end after the written data, and the system's reason for a refused write. */
#define _GNU_SOURCE
#include "superblock.h"
#include <errno.h>
#include <fcntl.h>
#include <stdint.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

/* Lock the file against other writers by a shared lock, which admits readers. Returns a descriptor; -1 if the file cannot be
   opened. File systems without locks are not protected. */
int tandem_guard_lock(const char *path)
{
    int file = open(path, O_RDWR | O_CLOEXEC | O_NONBLOCK);

    if (file >= 0)
        flock(file, LOCK_SH | LOCK_NB);
    return file;
}

/* Claim the file: until the descriptor is released, no other process can claim it. Returns a descriptor; -2 if another process has
   claimed the file, -1 if the file cannot be opened. The locked byte lies far after the end, so that readers are admitted. File
   systems without locks are not protected. */
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
int tandem_guard_is_locked(const char *path)
{
    int file = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK), is_locked;

    if (file < 0)
        return 0;
    is_locked = flock(file, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK;
    close(file);
    return is_locked;
}

/* True if the path still refers to the open file. */
int tandem_guard_still_exists(int file, const char *path)
{
    struct stat ours, theirs;

    return fstat(file, &ours) == 0 && stat(path, &theirs) == 0 && ours.st_dev == theirs.st_dev && ours.st_ino == theirs.st_ino;
}

/* Read the superblock, the stated end of the file, and the length of the file. Returns 0 if the superblock is invalid or of
   another version. */
static int read_superblock(int file, unsigned char *bytes, uint64_t *last, uint64_t *size)
{
    struct stat about;

    if (pread(file, bytes, superblock_size, 0) != superblock_size || fstat(file, &about) != 0 || !tandem_superblock_is_known(bytes))
        return 0;
    *last = tandem_superblock_end(bytes);
    *size = (uint64_t)about.st_size;
    return 1;
}

/* True if the file has the signature of HDF5 and is not shorter than its superblock states, as driver.c guarantees. */
int tandem_guard_is_whole(int file)
{
    unsigned char bytes[superblock_size];
    struct stat about;

    return pread(file, bytes, superblock_size, 0) == superblock_size && fstat(file, &about) == 0 &&
           tandem_superblock_is_signed(bytes) &&
           (!tandem_superblock_is_known(bytes) || tandem_superblock_end(bytes) <= (uint64_t)about.st_size);
}

/* Remove the mark of a writer from the superblock, and extend the file to the stated end, or to `end` if this is later. Called
   before a flush, so that flushed data never lie after the stated end. A superblock of another version is left unchanged. */
void tandem_guard_repair(int file, int64_t end)
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
    /* After a failure the mark remains; readers can then open the file in SWMR mode. */
    if (pwrite(file, bytes, superblock_size, 0) != superblock_size)
        return;
}

/* Truncate the file to the stated end, after which lies unused space for rows. */
void tandem_guard_trim(int file)
{
    unsigned char bytes[superblock_size];
    uint64_t last, size;

    if (!read_superblock(file, bytes, &last, &size) || last >= size)
        return;
    /* After a failure the unused space remains. */
    if (ftruncate(file, (off_t)last) != 0)
        return;
}

/* True if the file can grow by `bytes`; its length stays unchanged. */
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

/* Copy the system's message if its last error was a refusal to write. Returns the length of the message; 0 if there is none. */
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

void tandem_guard_clear_reason(void)
{
    errno = 0;
}
