/* SPDX-License-Identifier: MIT */
/* Long work that a user ends: it stops at the next place where that is possible, and what was done is kept. */
#ifndef MESHKAL_HOST_SIGNALS_H
#define MESHKAL_HOST_SIGNALS_H

/* From now on SIGINT, SIGTERM and SIGUSR1 (which mpirun passes on, killing nobody after it) are noted, and a reader that goes away is
   an error of writing, not the end of the process. */
void mk_catch_signals(void);
/* 1 once one of them has come, to all threads. */
int mk_stopped(void);

#endif
