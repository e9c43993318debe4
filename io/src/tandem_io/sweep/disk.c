/* SPDX-License-Identifier: MIT */
/* Synchronises files with the disk, because data buffered by the system are lost in a power failure. */
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <string.h>
#include <unistd.h>

/* Synchronise an open file; 0 on success, and on file systems without this operation. */
int tandem_disk_sync_open(int file)
{
    while (fsync(file) != 0) {
        if (errno == EINVAL || errno == ENOSYS || errno == EROFS || errno == ENOTSUP)
            return 0;
        if (errno != EINTR)
            return -1;
    }
    return 0;
}

/* Synchronise the contents of a file, or the names in a folder; 0 on success. */
int tandem_disk_sync(const char *path)
{
    int file = open(path, O_RDONLY | O_CLOEXEC), status;

    if (file < 0)
        return -1;
    status = tandem_disk_sync_open(file);
    close(file);
    return status;
}

/* Synchronise the folder of a file; 0 on success. */
int tandem_disk_sync_folder_of(const char *path)
{
    char folder[PATH_MAX];
    const char *slash = strrchr(path, '/');
    size_t length = slash ? (size_t)(slash - path) + 1 : 0;

    if (length >= sizeof folder)
        return -1;
    memcpy(folder, path, length);
    folder[length] = 0;
    /* A folder without read permission cannot be opened; the system writes its names to the disk later. */
    if (tandem_disk_sync(length > 0 ? folder : ".") != 0 && errno != EACCES)
        return -1;
    return 0;
}
