/* SPDX-License-Identifier: MIT */
/* From reset to main: called by start.S, which has set the stack and the floating-point unit. */
#include "semihost.h"

/* From image.ld. */
extern uint32_t mk_data_start[], mk_data_end[], mk_bss_start[], mk_bss_end[];
extern const uint32_t mk_data_load[];

int main(void);
void mk_start(void) __attribute__((noreturn));

void mk_start(void) {
    const uint32_t *from = mk_data_load;
    for (uint32_t *to = mk_data_start; to < mk_data_end;) *to++ = *from++;
    for (uint32_t *to = mk_bss_start; to < mk_bss_end;) *to++ = 0;
    mk_exit(main());
}
