/* SPDX-License-Identifier: MIT */
/* Processes that work for this one: each is a copy of it, joined to it by a pair of sockets that carry words of 64 bits. */
#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <sched.h>
#include <signal.h>
#include <stdint.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/types.h>
#include <sys/wait.h>
#include <unistd.h>

/* Start a copy of this process. Returns its number here, 0 in the copy, -1 where the system refuses; `end` is each one's end of
   the pair. `others` are the ends of other copies, which the new one closes: else it would keep them open. */
int tandem_process_start(const int *others, int n_others, int *end)
{
    int ends[2], parent = (int)getpid();
    pid_t process;

    if (socketpair(AF_UNIX, SOCK_STREAM, 0, ends) != 0)
        return -1;
    process = fork();
    if (process < 0) {
        close(ends[0]);
        close(ends[1]);
        return -1;
    }
    if (process > 0) {
        close(ends[1]);
        fcntl(ends[0], F_SETFL, fcntl(ends[0], F_GETFL) | O_NONBLOCK);
        fcntl(ends[0], F_SETFD, FD_CLOEXEC);
        *end = ends[0];
        return (int)process;
    }
    close(ends[0]);
    for (int i = 0; i < n_others; i++)
        if (others[i] >= 0)
            close(others[i]);
    /* Ctrl-C reaches all processes of the terminal; the first one tells the others. Whoever survives it would work for nobody. */
    signal(SIGINT, SIG_IGN);
    signal(SIGHUP, SIG_IGN);
    signal(SIGTERM, SIG_DFL);
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    if (getppid() != parent)
        _exit(0);
    *end = ends[1];
    return 0;
}

/* End this copy at once: nothing that the first process has not yet written is written twice. */
void tandem_process_leave(void)
{
    _exit(0);
}

/* Send words, all of them; 0 on success. Waits where there is no room. */
int tandem_process_send(int end, const void *words, int64_t n)
{
    const char *from = words;
    size_t left = (size_t)n * 8;

    while (left > 0) {
        ssize_t sent = send(end, from, left, MSG_NOSIGNAL);
        if (sent > 0) {
            from += sent;
            left -= (size_t)sent;
        } else if (errno == EAGAIN || errno == EWOULDBLOCK) {
            struct pollfd ready = {end, POLLOUT, 0};
            poll(&ready, 1, 1000);
        } else if (errno != EINTR) {
            return -1;
        }
    }
    return 0;
}

/* Wait for exactly so many words; 0 on success. */
int tandem_process_receive(int end, void *words, int64_t n)
{
    char *to = words;
    size_t left = (size_t)n * 8;

    while (left > 0) {
        ssize_t got = recv(end, to, left, 0);
        if (got > 0) {
            to += got;
            left -= (size_t)got;
        } else if (got == 0 || errno != EINTR) {
            return -1;
        }
    }
    return 0;
}

/* Take what has come, behind the first `have` bytes of `room`: bytes, 0 for none, -1 where the other end is closed. */
int64_t tandem_process_take(int end, void *room, int64_t have, int64_t size)
{
    ssize_t got;

    if (have >= size)
        return 0;
    do
        got = recv(end, (char *)room + have, (size_t)(size - have), 0);
    while (got < 0 && errno == EINTR);
    if (got > 0)
        return got;
    return got < 0 && (errno == EAGAIN || errno == EWOULDBLOCK) ? 0 : -1;
}

/* Wait until something has come from one of them, or the time has passed. */
void tandem_process_wait(const int *ends, int n, int milliseconds)
{
    struct pollfd ready[n > 0 ? n : 1];

    for (int i = 0; i < n; i++)
        ready[i] = (struct pollfd){ends[i], POLLIN, 0};
    poll(ready, (nfds_t)n, milliseconds);
}

/* End a process and close its end; the number of the signal that it died of, 0 where it had left by itself. */
int tandem_process_end(int process, int end, int kills)
{
    int status = 0;

    close(end);
    if (kills)
        kill((pid_t)process, SIGKILL);
    while (waitpid((pid_t)process, &status, 0) < 0 && errno == EINTR)
        ;
    return WIFSIGNALED(status) ? WTERMSIG(status) : 0;
}

/* How many processors this process may use. */
int tandem_process_cores(void)
{
    cpu_set_t set;

    CPU_ZERO(&set);
    if (sched_getaffinity(0, sizeof set, &set) != 0)
        return 1;
    return CPU_COUNT(&set);
}
