/* SPDX-License-Identifier: MIT */
/* Signals that end the program. The first signal is recorded, and the run checks for it; a second one has its default action. */
#include <signal.h>
#include <string.h>

static volatile sig_atomic_t caught = 0;

static void record(int number)
{
    if (caught != 0) {
        signal(number, SIG_DFL);
        raise(number);
    }
    caught = number;
}

void tandem_watch_signals(void)
{
    static const int numbers[] = {SIGINT, SIGTERM, SIGHUP};
    struct sigaction action, before;

    memset(&action, 0, sizeof action);
    sigemptyset(&action.sa_mask);
    action.sa_handler = record;
    action.sa_flags = SA_RESTART;
    for (size_t i = 0; i < sizeof numbers / sizeof *numbers; i++) {
        /* Signals that are ignored by the calling process, such as SIGHUP under nohup, remain ignored. */
        if (sigaction(numbers[i], NULL, &before) == 0 && before.sa_handler != SIG_IGN)
            sigaction(numbers[i], &action, NULL);
    }
    /* Exceeding the largest size of a file is reported by the write instead of ending the program. */
    signal(SIGXFSZ, SIG_IGN);
}

int tandem_caught_signal(void)
{
    return (int)caught;
}
