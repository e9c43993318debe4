/* SPDX-License-Identifier: MIT */
/* What the program says on stdout. gfortran's own writes succeed where the disk is full; C tells of it. */
#include <errno.h>
#include <stdio.h>
#include <string.h>

/* Why something could not be written, the first time; 0 where all could. */
static int problem = 0;

void tandem_say(const char *text, size_t length)
{
    if (fwrite(text, 1, length, stdout) != length && problem == 0)
        problem = errno;
}

/* Bring all to where it goes. The length of the system's words for what stood in the way; 0 where nothing did. */
int tandem_finish_output(char *text, int size)
{
    if (fflush(stdout) != 0 && problem == 0)
        problem = errno;
    if (problem == 0)
        return 0;
    strncpy(text, strerror(problem), (size_t)size);
    return (int)strnlen(text, (size_t)size);
}
