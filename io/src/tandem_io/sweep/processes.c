/* SPDX-License-Identifier: MIT */
/* Worker processes: copies of this process, connected to it by pairs of sockets that carry 64-bit words. */
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

/* Start a copy of this process. Returns the process identifier in this process, 0 in the copy, and -1 after a failure. `end` is the
   socket of the calling process. `others` are the sockets of other copies, which the new copy must close. */
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
    /* Ctrl-C is sent to all processes of the terminal, but only the first process must react: it ends the copies. A copy must not
       outlive the first process. */
    signal(SIGINT, SIG_IGN);
    signal(SIGHUP, SIG_IGN);
    signal(SIGTERM, SIG_DFL);
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    if (getppid() != parent)
        _exit(0);
    *end = ends[1];
    return 0;
}

/* End this copy without flushing buffers, whose contents the first process writes itself. */
void tandem_process_leave(void)
{
    _exit(0);
}

/* Send n words, and wait while the socket is full; 0 on success. */
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

/* Receive exactly n words, and wait for them; 0 on success. */
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

/* Receive available data after the first `have` bytes of the buffer `room`, without waiting. Returns the number of bytes; -1 if the
   other socket is closed. */
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

/* Wait until data are available at one of the sockets, at most for a number of milliseconds. */
void tandem_process_wait(const int *ends, int n, int milliseconds)
{
    struct pollfd ready[n > 0 ? n : 1];

    for (int i = 0; i < n; i++)
        ready[i] = (struct pollfd){ends[i], POLLIN, 0};
    poll(ready, (nfds_t)n, milliseconds);
}

/* Close the socket of a process, kill the process if requested, and wait for its end. Returns the number of the signal that ended
   it; 0 if it exited. */
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

/* Number of processors available to this process. */
int tandem_process_cores(void)
{
    cpu_set_t set;

    CPU_ZERO(&set);
    if (sched_getaffinity(0, sizeof set, &set) != 0)
        return 1;
    return CPU_COUNT(&set);
}
