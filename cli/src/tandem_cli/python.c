/* SPDX-License-Identifier: MIT */
/* Execution of a subcommand by Python. The interpreter replaces the process, so that it receives signals and sets the exit code. */
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

/* Path of the interpreter: the value of TANDEM_PYTHON, the interpreter in the environment that `make python` creates beside the
   program, or python3. */
static const char *interpreter(void)
{
    static char path[4096];
    const char *named = getenv("TANDEM_PYTHON");
    char *slash;
    ssize_t length;

    if (named != NULL && *named != '\0')
        return named;
    length = readlink("/proc/self/exe", path, sizeof path - 32);
    if (length > 0) {
        path[length] = '\0';
        slash = strrchr(path, '/');
        if (slash != NULL) {
            strcpy(slash, "/python/bin/python3");
            if (access(path, X_OK) == 0)
                return path;
        }
    }
    return "python3";
}

/* Execute Python code with arguments, each terminated by a NUL. Returns only if the interpreter cannot be started; then `text` is
   its name and the reason, and the result is the length of `text`. */
int tandem_call_python(const char *code, const char *words, int count, char *text, int size)
{
    const char *name = interpreter();
    char **arguments = malloc((size_t)(count + 4) * sizeof *arguments);
    int i, written;

    if (arguments != NULL) {
        arguments[0] = (char *)name;
        arguments[1] = "-c";
        arguments[2] = (char *)code;
        for (i = 0; i < count; i++) {
            arguments[i + 3] = (char *)words;
            words += strlen(words) + 1;
        }
        arguments[count + 3] = NULL;
        execvp(name, arguments);
        free(arguments);
    }
    written = snprintf(text, (size_t)size, "%s: %s", name, strerror(errno));
    return written < size ? written : size - 1;
}
