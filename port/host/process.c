/* SPDX-License-Identifier: MIT */
#include "process.h"

#include <stdio.h>
#include <sys/resource.h>
#include <time.h>

double mk_peak_memory(void) {
    /* Linux counts a process's maximum resident set on from that of the program that started it; its high-water mark starts anew. */
    FILE *status = fopen("/proc/self/status", "r");
    char line[256];
    double kilobytes = 0.0;
    while (status && fgets(line, sizeof line, status))
        if (sscanf(line, "VmHWM: %lf", &kilobytes) == 1) break;
    if (status) (void)fclose(status);
    struct rusage usage;
    if (!(kilobytes > 0.0) && getrusage(RUSAGE_SELF, &usage) == 0) kilobytes = (double)usage.ru_maxrss;
    return 1024.0 * kilobytes;
}

double mk_seconds(void) {
    struct timespec time;
    (void)clock_gettime(CLOCK_MONOTONIC, &time);
    return (double)time.tv_sec + 1e-9 * (double)time.tv_nsec;
}
