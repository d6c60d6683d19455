/* SPDX-License-Identifier: MIT */
/* Vector table, reset, the way to the fault report, and the semihosting trap, for Armv6-M, v7-M and v8-M. */
    .syntax unified
    .thumb

/* Handlers that an application may define (interrupts.h); all else is a fault. */
    .weak mk_system_tick
    .thumb_set mk_system_tick, mk_fault_entry
    .weak mk_interrupt
    .thumb_set mk_interrupt, mk_fault_entry

#if __ARM_ARCH == 6
#define INTERRUPTS 32
#else
#define INTERRUPTS 96
#endif

    .section .vectors, "a", %progbits
    .word mk_stack_top
    .word mk_reset
    .rept 13 /* non-maskable interrupt, faults, supervisor call, debug, pended call */
    .word mk_fault_entry
    .endr
    .word mk_system_tick
    .rept INTERRUPTS
    .word mk_interrupt
    .endr

    .section .text.mk_reset, "ax", %progbits
    .global mk_reset
    .type mk_reset, %function
mk_reset:
    /* A debugger may start here without the vector table. */
    ldr r0, =mk_stack_top
    mov sp, r0
#if __ARM_ARCH == 7
    /* The boards AN386 and AN500 swallow writes below their RAM. The memory protection unit makes 0x10000000 to 0x1fffffff
       a fault, for an overflowing stack; all else stays as it is. */
    ldr r0, =0xe000ed94
    ldr r1, =0x10000010
    str r1, [r0, #8]
    ldr r1, =0x10000037
    str r1, [r0, #12]
    movs r1, #5
    str r1, [r0]
    dsb
    isb
#endif
#ifdef __ARM_FP
    /* CPACR: full access to the floating-point unit. */
    ldr r0, =0xe000ed88
    ldr r1, [r0]
    orr r1, r1, #(0xf << 20)
    str r1, [r0]
    dsb
    isb
#endif
    bl mk_start
    .size mk_reset, . - mk_reset

    .section .text.mk_fault_entry, "ax", %progbits
    .global mk_fault_entry
    .type mk_fault_entry, %function
mk_fault_entry:
    mov r0, sp
    mrs r1, ipsr
    /* The stack may be what is at fault: start it anew, nothing returns from here. */
    ldr r2, =mk_stack_top
    mov sp, r2
    bl mk_fault
    .size mk_fault_entry, . - mk_fault_entry

    .section .text.mk_semihost_call, "ax", %progbits
    .global mk_semihost_call
    .type mk_semihost_call, %function
mk_semihost_call:
    bkpt 0xab
    bx lr
    .size mk_semihost_call, . - mk_semihost_call
