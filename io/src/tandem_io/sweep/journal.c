/* SPDX-License-Identifier: MIT */
/* A file of 64-bit words that is written by one process. Output is not buffered: failures are reported at once, and a copy of the
   process cannot write the same data again. */
#include <errno.h>
#include <fcntl.h>
#include <stdint.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

/* Open a file for reading (writes = 0) or for reading and writing (writes = 1); in the second case, create and lock the file.
   Returns a descriptor; -1 if the file cannot be opened, -2 if another process writes it. File systems without locks are not
   protected. */
int tandem_journal_open(const char *path, int writes)
{
    int file = open(path, (writes ? O_RDWR | O_CREAT : O_RDONLY) | O_CLOEXEC | O_NONBLOCK, 0666);
    struct stat about;

    if (file < 0)
        return -1;
    if (fstat(file, &about) != 0 || !S_ISREG(about.st_mode)) {
        close(file);
        return -1;
    }
    if (writes && flock(file, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK) {
        close(file);
        return -2;
    }
    return file;
}

/* Read up to n words at a position in bytes. Returns the number of words read. */
int64_t tandem_journal_read(int file, void *words, int64_t n, int64_t position)
{
    char *to = words;
    size_t have = 0, size = (size_t)n * 8;

    while (have < size) {
        ssize_t got = pread(file, to + have, size - have, (off_t)position + (off_t)have);
        if (got > 0)
            have += (size_t)got;
        else if (got == 0 || errno != EINTR)
            break;
    }
    return (int64_t)(have / 8);
}

/* Write n words at a position in bytes; 0 on success. */
int tandem_journal_write(int file, const void *words, int64_t n, int64_t position)
{
    const char *from = words;
    size_t done = 0, size = (size_t)n * 8;

    while (done < size) {
        ssize_t put = pwrite(file, from + done, size - done, (off_t)position + (off_t)done);
        if (put > 0)
            done += (size_t)put;
        else if (put == 0 || errno != EINTR)
            return -1;
    }
    return 0;
}

/* Truncate or extend the file to `end` bytes, unless this is -1. Returns the length of the file; -1 after a failure. */
int64_t tandem_journal_size(int file, int64_t end)
{
    struct stat about;

    if (end >= 0 && ftruncate(file, (off_t)end) != 0)
        return -1;
    return fstat(file, &about) == 0 ? (int64_t)about.st_size : -1;
}

void tandem_journal_close(int file)
{
    close(file);
}
