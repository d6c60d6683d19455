/* SPDX-License-Identifier: MIT */
/* Reset, the way to the trap report, and the semihosting trap, for RV32 in machine mode. Interrupts stay off. */
    .option arch, +zicsr

    .section .vectors, "ax", @progbits
    .global mk_reset
    .type mk_reset, @function
mk_reset:
    .option push
    .option norelax
    la gp, __global_pointer$
    .option pop
    la sp, mk_stack_top
    la t0, mk_trap_entry
    csrw mtvec, t0
    /* Physical memory protection, locked, so that it binds machine mode too: from mk_flash_start up to mk_flash_end read and
       execute only. A write through a stray pointer or an overflowing stack traps as on a chip with flash. */
    la t0, mk_flash_start
    srli t0, t0, 2
    csrw pmpaddr0, t0
    la t0, mk_flash_end
    srli t0, t0, 2
    csrw pmpaddr1, t0
    li t0, 0x8d00
    csrw pmpcfg0, t0
#ifdef __riscv_flen
    /* mstatus.FS := initial; round to nearest, no flags. */
    li t0, 0x2000
    csrs mstatus, t0
    csrw fcsr, zero
#endif
    call mk_start
    .size mk_reset, . - mk_reset

    .section .text.mk_trap_entry, "ax", @progbits
    .balign 4
    .type mk_trap_entry, @function
mk_trap_entry:
    mv a3, sp
    /* The stack may be what is at fault: start it anew, nothing returns from here. */
    la sp, mk_stack_top
    csrr a0, mcause
    csrr a1, mepc
    csrr a2, mtval
    call mk_trap
    .size mk_trap_entry, . - mk_trap_entry

    .section .text.mk_semihost_call, "ax", @progbits
    .global mk_semihost_call
    .type mk_semihost_call, @function
    /* The three instructions are known by their neighbours: never compressed, never across a page. */
    .balign 16
    .option push
    .option norvc
mk_semihost_call:
    slli zero, zero, 0x1f
    ebreak
    srai zero, zero, 7
    ret
    .option pop
    .size mk_semihost_call, . - mk_semihost_call
