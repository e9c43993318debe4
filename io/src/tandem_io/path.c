/* SPDX-License-Identifier: MIT */
/* Tests of paths that do not open the file, because opening a pipe may block. */
#include <sys/stat.h>

/* True if two paths refer to the same file, possibly through links. */
int tandem_path_is_same(const char *one, const char *other)
{
    struct stat first, second;

    return stat(one, &first) == 0 && stat(other, &second) == 0 && first.st_dev == second.st_dev && first.st_ino == second.st_ino;
}

/* True if a path refers to a regular file. */
int tandem_path_is_regular(const char *path)
{
    struct stat about;

    return stat(path, &about) == 0 && S_ISREG(about.st_mode);
}

/* True if a path refers to a pipe, named or unnamed. */
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
