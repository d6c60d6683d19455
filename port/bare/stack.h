/* SPDX-License-Identifier: MIT */
/*
 * How much stack code needs, measured: paint it, run the code, look how far the paint is gone.
 *
 *     mk_stack_paint();
 *     const uint32_t before = mk_stack_depth();
 *     code();
 *     bytes = mk_stack_used() - before;
 *
 * The stack lies at the bottom of RAM, so that an overflow leaves memory and faults instead of spoiling data. Its size is the
 * linker's symbol mk_stack_size (image.ld); change it with -Wl,--defsym=mk_stack_size=0x1000.
 */
#ifndef MESHKAL_BARE_STACK_H
#define MESHKAL_BARE_STACK_H

#include <stdint.h>

/* Lowest word of the stack and the word above its highest: from the linker. */
extern uint32_t mk_stack_bottom[], mk_stack_top[];

/* Fills all that lies below the caller's frame. */
void mk_stack_paint(void);

/* Bytes in use at this moment, as the caller stands. */
uint32_t mk_stack_depth(void);

/* Bytes from the top of the stack to the deepest word that was written since painting; interrupts count. */
uint32_t mk_stack_used(void);

/* All there is. */
uint32_t mk_stack_capacity(void);

#endif
