/* SPDX-License-Identifier: MIT */
#include "stack.h"

#define PAINT UINT32_C(0xa5c35a3c)

#ifdef __riscv
#define MOVE "mv"
#else
#define MOVE "mov"
#endif

/* Own frame included, which is nothing or a few words: the functions here call none. */
static inline __attribute__((always_inline)) uint32_t *pointer(void) {
    uint32_t *sp;
    __asm__ volatile(MOVE " %0, sp" : "=r"(sp));
    return sp;
}

static uint32_t distance(const uint32_t *low, const uint32_t *high) { return (uint32_t)((uintptr_t)high - (uintptr_t)low); }

/* volatile: neither a call of memset, whose frame would be painted over, nor dropped. */
void mk_stack_paint(void) {
    uint32_t *const end = pointer();
    for (volatile uint32_t *word = mk_stack_bottom; word < end; word++) *word = PAINT;
}

uint32_t mk_stack_depth(void) { return distance(pointer(), mk_stack_top); }

uint32_t mk_stack_used(void) {
    const volatile uint32_t *word = mk_stack_bottom;
    while (word < mk_stack_top && *word == PAINT) word++;
    return distance((const uint32_t *)(uintptr_t)word, mk_stack_top);
}

uint32_t mk_stack_capacity(void) { return distance(mk_stack_bottom, mk_stack_top); }
