/* SPDX-License-Identifier: MIT */
/* Lists a folder, in C because the layout of struct dirent differs between systems. */
#include <dirent.h>
#include <string.h>

/* Write the names in a folder, each followed by a newline, into `names` of `size` bytes. Returns the number of bytes written, 0 if
   the folder cannot be read. Names for which there is no space are omitted. */
int tandem_list_folder(const char *path, char *names, int size)
{
    int length = 0;
    struct dirent *entry;
    DIR *folder = opendir(path);

    if (folder == NULL)
        return 0;
    while ((entry = readdir(folder)) != NULL) {
        size_t more = strlen(entry->d_name);
        if (more + 1 > (size_t)(size - length))
            continue;
        memcpy(names + length, entry->d_name, more);
        length += (int)more;
        names[length++] = '\n';
    }
    closedir(folder);
    return length;
}
