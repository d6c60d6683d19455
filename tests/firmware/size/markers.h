/* SPDX-License-Identifier: MIT */
/* Markers for the instruction counter (count.c): what runs between a begin and the end is counted under the begin's name. And loops whose count is known. */
#ifndef SIZE_MARKERS_H
#define SIZE_MARKERS_H

#include "semihost.h"

#define MARKER(name) \
    void name(void); \
    __attribute__((noinline)) void name(void) { __asm__ volatile("" : : "i"(#name)); }
MARKER(size_begin_nothing)
MARKER(size_begin_loop_100)
MARKER(size_begin_loop_300)
MARKER(size_end)

/* Two instructions a turn, so the longer loop has 400 more. */
void size_loop_100(void);
void size_loop_300(void);
#ifdef __riscv
#define LOOP(count) "size_loop_" #count ":\nli t0, " #count "\n1: addi t0, t0, -1\nbnez t0, 1b\nret\n"
#else
#define LOOP(count) ".syntax unified\n.thumb_func\nsize_loop_" #count ":\nldr r0, =" #count "\n1: subs r0, #1\nbne 1b\nbx lr\n.ltorg\n"
#endif
__asm__(".text\n.balign 4\n.global size_loop_100, size_loop_300\n" LOOP(100) ".balign 4\n" LOOP(300) ".balign 4\n");

/* First of all: what the markers themselves cost, and the loops. A function of its own, or its caller's work moves in between. */
void size_loops(void);
__attribute__((noinline)) void size_loops(void) {
    size_begin_nothing();
    size_end();
    size_begin_loop_100();
    size_loop_100();
    size_end();
    size_begin_loop_300();
    size_loop_300();
    size_end();
    __asm__ volatile(""); /* or the last call would be a jump, after the return is prepared */
}

/* One call of a function, counted, its stack measured: status and worst[] are the caller's, who includes stack.h. */
#define CALL(function, begin, call) \
    do { \
        mk_stack_paint(); \
        const uint32_t before = mk_stack_depth(); \
        begin(); \
        status = (call); \
        size_end(); \
        const uint32_t used = mk_stack_used() - before; \
        if (used > worst[function]) worst[function] = used; \
    } while (0)

/* For size.py: the most stack of each function, and the object's RAM. */
static void size_tell(int functions, const char *const *name, const uint32_t *stack, uint32_t ram) {
    for (int k = 0; k < functions; k++) {
        mk_write("stack ");
        mk_write(name[k]);
        mk_write(" ");
        mk_write_number(stack[k]);
        mk_write("\n");
    }
    mk_write("ram ");
    mk_write_number(ram);
    mk_write("\n");
}

#endif
