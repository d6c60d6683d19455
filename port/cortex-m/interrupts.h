/* SPDX-License-Identifier: MIT */
/* Interrupts on Cortex-M. Handlers are ordinary C functions; one that is not defined here or by the application is a fault. */
#ifndef MESHKAL_CORTEX_M_INTERRUPTS_H
#define MESHKAL_CORTEX_M_INTERRUPTS_H

#include <stdint.h>

/* Defined by the application: the system timer, and every interrupt of a device (32 on Armv6-M, 96 elsewhere). */
void mk_system_tick(void);
void mk_interrupt(void);

/* Inside mk_interrupt: the number of the device's interrupt, from 0. */
static inline uint32_t mk_interrupt_number(void) {
    uint32_t exception;
    __asm__ volatile("mrs %0, ipsr" : "=r"(exception));
    return exception - 16u;
}

#endif
