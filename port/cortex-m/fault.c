/* SPDX-License-Identifier: MIT */
/* Any exception that the application does not handle: say what and where, end with MK_EXIT_FAULT. */
#include "semihost.h"
#include "stack.h"

void mk_fault(const uint32_t *frame, uint32_t exception) __attribute__((noreturn));

static void field(const char *name, uint32_t value) {
    mk_write(name);
    mk_write_hex(value, 8);
}

/* frame: the stack as the exception left it, r0 to r3, r12, lr, pc, psr upwards. */
void mk_fault(const uint32_t *frame, uint32_t exception) {
    mk_write("fault: exception ");
    mk_write_number(exception);
    if (frame >= mk_stack_bottom && frame + 8 <= mk_stack_top) {
        field(" at pc 0x", frame[6]);
        field(", called from 0x", frame[5]);
    } else {
        field(": stack overflow, sp 0x", (uint32_t)(uintptr_t)frame);
    }
#if __ARM_ARCH > 6
    field(", fault status 0x", *(const volatile uint32_t *)0xe000ed28u);
#endif
    mk_write("\n");
    mk_exit(MK_EXIT_FAULT);
}
