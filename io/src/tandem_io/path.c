/* SPDX-License-Identifier: MIT */
/* What a path leads to, without opening it: to open a pipe may wait for ever. */
#include <sys/stat.h>

/* Whether two paths lead to one file, however they are spelled: by links too. */
int tandem_path_is_same(const char *one, const char *other)
{
    struct stat first, second;

    return stat(one, &first) == 0 && stat(other, &second) == 0 && first.st_dev == second.st_dev && first.st_ino == second.st_ino;
}

/* Whether a path leads to a regular file. */
int tandem_path_is_regular(const char *path)
{
    struct stat about;

    return stat(path, &about) == 0 && S_ISREG(about.st_mode);
}

/* Whether a path leads to a pipe, named or not. */
int tandem_path_is_pipe(const char *path)
{
    struct stat about;

    return stat(path, &about) == 0 && S_ISFIFO(about.st_mode);
}

/* Whether a path is a symbolic link that leads to nothing. */
int tandem_path_is_dangling(const char *path)
{
    struct stat about;

    return lstat(path, &about) == 0 && S_ISLNK(about.st_mode) && stat(path, &about) != 0;
}
