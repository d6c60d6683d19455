/* SPDX-License-Identifier: MIT */
/* The port under test: what must stand before main, files, command line, stack measurement, and that trouble ends the image with a
   failure. Command line: NAME WHAT [PATH]. */
#include <stddef.h>
#include <string.h>

#include "semihost.h"
#include "stack.h"

static volatile uint32_t preset = 0x12345678u;
static volatile double preset_real = 0.1;
static volatile uint8_t preset_bytes[5] = {1, 2, 3, 4, 5};
static volatile uint32_t zero[64];
static volatile float half = 0.5f;

static void check(int good, const char *what) {
    if (good) return;
    mk_write("wrong: ");
    mk_write(what);
    mk_write("\n");
    mk_exit(1);
}

extern void mk_reset(void);

/* Emulators start with memory that is zero, chips do not: spoil it and start again. The lowest words of the stack tell the two starts apart. */
static void spoil_once(void) {
    static const uint32_t mark = 0x600dbeefu;
    volatile uint32_t *const second = mk_stack_bottom;
    if (*second == mark) {
        *second = 0;
        return;
    }
    *second = mark;
    preset = 0xdeadu;
    preset_real = -1.0;
    preset_bytes[4] = half > 0.0f;
    half = -1.0f;
    for (int i = 0; i < 64; i++) zero[i] = 0xa5a5a5a5u;
    mk_reset();
}

static void memory(void) {
    check(preset == 0x12345678u, ".data");
    check(preset_real == 0.1, ".data, double");
    check(preset_bytes[0] == 1 && preset_bytes[4] == 5, ".data, bytes");
    for (int i = 0; i < 64; i++) check(zero[i] == 0, ".bss");
    preset = 1;
    check(preset == 1, "RAM cannot be written");
    half = half * 3.0f;
    check(half == 1.5f, "arithmetic");
}

/* Writes `size` bytes on its stack, one deep frame. */
static __attribute__((noinline)) uint32_t deep(uint32_t size) {
    volatile uint8_t room[1024];
    for (uint32_t i = 0; i < size; i++) room[sizeof room - 1 - i] = (uint8_t)i;
    return room[sizeof room - 1];
}

static void stack(void) {
    mk_stack_paint();
    const uint32_t before = mk_stack_depth();
    check(before < 512, "stack: depth in main");
    check(mk_stack_used() >= before && mk_stack_used() < before + 64, "stack: used, before");
    (void)deep(1024);
    const uint32_t used = mk_stack_used() - before;
    check(used >= 1024 && used < 1024 + 128, "stack: used, after");
    check(mk_stack_capacity() == 0x2000, "stack: capacity");
    check(((uintptr_t)mk_stack_top & 7u) == 0, "stack: alignment");
}

static void file(const char *path) {
    static const char text[] = "written by the image\n";
    char back[64];
    memset(back, 0, sizeof back);
    const int out = mk_file_open(path, MK_FILE_WRITE);
    check(out >= 0, "open to write");
    check(mk_file_write(out, text, sizeof text - 1) == sizeof text - 1, "write");
    check(mk_file_close(out) == 0, "close");
    const int in = mk_file_open(path, MK_FILE_READ);
    check(in >= 0, "open to read");
    check(mk_file_read(in, back, sizeof back) == sizeof text - 1, "read");
    check(mk_file_read(in, back + 32, 8) == 0, "read at the end");
    check(memcmp(back, text, sizeof text) == 0, "what was written and read");
    check(mk_file_close(in) == 0, "close");
    check(mk_file_open("no/such/file", MK_FILE_READ) < 0, "open a file that is not there");
}

static volatile uint32_t bottomless = 1;
static uint32_t overflow(uint32_t depth) { /* the sum after the call keeps it a call */
    volatile uint32_t room[16];
    room[depth % 16] = depth;
    return bottomless ? overflow(depth + 1) + room[depth % 16] : 0;
}

int main(void) {
    char line[160], short_line[4];
    spoil_once();
    memory();
    stack();
    check(mk_command_line(line, sizeof line), "command line");
    check(!mk_command_line(short_line, sizeof short_line) && short_line[0] == 0, "command line longer than its room");
    const char *const what = strchr(line, ' ') + 1;
    check(what != (const char *)NULL + 1, "command line of one word");
    if (strncmp(what, "file ", 5) == 0) file(what + 5);
    else if (strcmp(what, "status") == 0) return 7;
    else if (strcmp(what, "instruction") == 0) __builtin_trap();
    else if (strcmp(what, "overflow") == 0) return (int)overflow(0);
    else if (strcmp(what, "below-ram") == 0) *(volatile uint32_t *)((uintptr_t)mk_stack_bottom - 4u) = 1;
    else return 2;
    return 0;
}
