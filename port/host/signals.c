/* SPDX-License-Identifier: MIT */
#include "signals.h"

#include <signal.h>
#include <string.h>

/* Any thread may run the handler and all of them look: sig_atomic_t promises something to one thread only. */
static int stop_now;

static void on_signal(int number) {
    (void)number;
    __atomic_store_n(&stop_now, 1, __ATOMIC_RELAXED);
}

int mk_stopped(void) { return __atomic_load_n(&stop_now, __ATOMIC_RELAXED); }

void mk_catch_signals(void) {
    struct sigaction action;
    memset(&action, 0, sizeof action);
    action.sa_handler = on_signal;
    (void)sigaction(SIGINT, &action, NULL);
    (void)sigaction(SIGTERM, &action, NULL);
    (void)sigaction(SIGUSR1, &action, NULL);
    /* A reader that goes away is an error of writing, not the end of the process. */
    action.sa_handler = SIG_IGN;
    (void)sigaction(SIGPIPE, &action, NULL);
}
