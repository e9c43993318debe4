/* SPDX-License-Identifier: MIT */
/* Kind of file at a path, found without opening it: opening a pipe may block for ever. */
#include <sys/stat.h>

/* True if two paths lead to one file, however they are spelled: through links too. */
int tandem_path_is_same(const char *one, const char *other)
{
    struct stat first, second;

    return stat(one, &first) == 0 && stat(other, &second) == 0 && first.st_dev == second.st_dev && first.st_ino == second.st_ino;
}

/* True if a path leads to a regular file. */
int tandem_path_is_regular(const char *path)
{
    struct stat about;

    return stat(path, &about) == 0 && S_ISREG(about.st_mode);
}

/* True if a path leads to a pipe, named or not. */
int tandem_path_is_pipe(const char *path)
{
    struct stat about;

    return stat(path, &about) == 0 && S_ISFIFO(about.st_mode);
}

/* True if a path is a dangling symbolic link. */
int tandem_path_is_dangling(const char *path)
{
    struct stat about;

    return lstat(path, &about) == 0 && S_ISLNK(about.st_mode) && stat(path, &about) != 0;
}
