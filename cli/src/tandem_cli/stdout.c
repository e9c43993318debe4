/* SPDX-License-Identifier: MIT */
/* Output of the program on stdout. Writes of C report a full disk, unlike those of gfortran. */
#include <errno.h>
#include <stdio.h>
#include <string.h>

/* First write error; 0 if none. */
static int problem = 0;

void tandem_say(const char *text, size_t length)
{
    if (fwrite(text, 1, length, stdout) != length && problem == 0)
        problem = errno;
}

/* Flush the output. Returns the length of the system's message about the first error; 0 if there was none. */
int tandem_finish_output(char *text, int size)
{
    if (fflush(stdout) != 0 && problem == 0)
        problem = errno;
    if (problem == 0)
        return 0;
    strncpy(text, strerror(problem), (size_t)size);
    return (int)strnlen(text, (size_t)size);
}
