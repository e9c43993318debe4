/* SPDX-License-Identifier: MIT */
/* A file of words of 64 bits that one process writes: each failure is reported at once, and nothing is buffered that a copy of
   the process could write a second time. */
#include <errno.h>
#include <fcntl.h>
#include <stdint.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

/* Open a file to read (0), or to write too (1), made if it is missing. -1 if it cannot be opened, -2 if another process
   writes it. No lock on file systems without locks. */
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

/* Read up to n words at a place in bytes: how many there were. */
int64_t tandem_journal_read(int file, void *words, int64_t n, int64_t place)
{
    char *to = words;
    size_t have = 0, size = (size_t)n * 8;

    while (have < size) {
        ssize_t got = pread(file, to + have, size - have, (off_t)place + (off_t)have);
        if (got > 0)
            have += (size_t)got;
        else if (got == 0 || errno != EINTR)
            break;
    }
    return (int64_t)(have / 8);
}

/* Write n words at a place in bytes; 0 on success. */
int tandem_journal_write(int file, const void *words, int64_t n, int64_t place)
{
    const char *from = words;
    size_t done = 0, size = (size_t)n * 8;

    while (done < size) {
        ssize_t put = pwrite(file, from + done, size - done, (off_t)place + (off_t)done);
        if (put > 0)
            done += (size_t)put;
        else if (put == 0 || errno != EINTR)
            return -1;
    }
    return 0;
}

/* Let the file end at a place, -1 for where it does; how long it is then. */
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
