/* SPDX-License-Identifier: MIT */
/* A child process for work in which a library may crash, such as HDF5 with a damaged file. */
#include <errno.h>
#include <signal.h>
#include <sys/resource.h>
#include <sys/types.h>
#include <sys/wait.h>
#include <unistd.h>

enum { in_child = -1, killed = 1000 };

/* Create a child process. Returns -1 in the child, where the caller does the work; a crash ends the child silently, without a core
   file. In the parent, waits for the child and returns its exit code, or 1000 plus the number of the signal that ended it. If the
   child cannot be created, returns -1, so that the caller does the work itself. */
int tandem_fork_and_wait(void)
{
    static const int crashes[] = {SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT};
    const struct rlimit none = {0, 0};
    int status = 0;
    pid_t child = fork(), ended;

    if (child < 0)
        return in_child;
    if (child == 0) {
        for (size_t i = 0; i < sizeof crashes / sizeof *crashes; i++)
            signal(crashes[i], SIG_DFL);
        setrlimit(RLIMIT_CORE, &none);
        return in_child;
    }
    do
        ended = waitpid(child, &status, 0);
    while (ended < 0 && errno == EINTR);
    if (ended < 0)
        return killed;
    return WIFSIGNALED(status) ? killed + WTERMSIG(status) : WEXITSTATUS(status);
}
