/* SPDX-License-Identifier: MIT */
/* The names in a folder. Fortran cannot list a folder, and the layout of C's struct dirent differs between systems. */
#include <dirent.h>
#include <string.h>

/* Writes the names, each with a newline after it, into `names` of `size` bytes. Returns how many bytes were written:
   0 where the folder cannot be read. Names that find no room are left out. */
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
