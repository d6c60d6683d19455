/* SPDX-License-Identifier: MIT */
/* Any trap: say what and where, end with MK_EXIT_FAULT. */
#include "semihost.h"
#include "stack.h"

void mk_trap(uint32_t cause, uint32_t pc, uint32_t value, const uint32_t *sp) __attribute__((noreturn));

void mk_trap(uint32_t cause, uint32_t pc, uint32_t value, const uint32_t *sp) {
    mk_write("fault: cause 0x");
    mk_write_hex(cause, 8);
    mk_write(" at pc 0x");
    mk_write_hex(pc, 8);
    mk_write(", value 0x");
    mk_write_hex(value, 8);
    if (sp < mk_stack_bottom || sp > mk_stack_top) mk_write(": stack overflow");
    mk_write("\n");
    mk_exit(MK_EXIT_FAULT);
}
