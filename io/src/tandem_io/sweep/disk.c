/* SPDX-License-Identifier: MIT */
/* Synchronises files with the disk: data buffered by the system would be lost with the machine's power. */
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <string.h>
#include <unistd.h>

/* Sync an open file; 0 on success, and on file systems without this operation. */
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

/* Sync a file, or a folder with the names in it; 0 on success. A folder that fails to open contains no names written here. */
int tandem_disk_sync(const char *path)
{
    int file = open(path, O_RDONLY | O_CLOEXEC), status;

    if (file < 0)
        return -1;
    status = tandem_disk_sync_open(file);
    close(file);
    return status;
}

/* Sync the folder of a file; 0 on success. */
int tandem_disk_sync_folder_of(const char *path)
{
    char folder[PATH_MAX];
    const char *slash = strrchr(path, '/');
    size_t length = slash ? (size_t)(slash - path) + 1 : 0;

    if (length >= sizeof folder)
        return -1;
    memcpy(folder, path, length);
    folder[length] = 0;
    /* A folder that may be written but not read cannot be opened; its names come to the disk in time. */
    if (tandem_disk_sync(length > 0 ? folder : ".") != 0 && errno != EACCES)
        return -1;
    return 0;
}
