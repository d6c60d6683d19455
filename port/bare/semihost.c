/* SPDX-License-Identifier: MIT */
#include "semihost.h"

enum {
    OPEN = 0x01,
    CLOSE = 0x02,
    WRITE_TEXT = 0x04,
    WRITE = 0x05,
    READ = 0x06,
    COMMAND_LINE = 0x15,
    EXIT_EXTENDED = 0x20,
    APPLICATION_EXIT = 0x20026
};

/* A parameter block: words that are numbers or addresses. */
typedef uintptr_t block_t[3];

static uintptr_t address(const void *object) { return (uintptr_t)object; }

static uint32_t length(const char *text) {
    uint32_t count = 0;
    while (text[count]) count++;
    return count;
}

void mk_exit(int status) {
    const block_t block = {APPLICATION_EXIT, (uintptr_t)(status & 255)};
    for (;;) (void)mk_semihost_call(EXIT_EXTENDED, block);
}

void mk_write(const char *text) { (void)mk_semihost_call(WRITE_TEXT, text); }

void mk_write_number(uint32_t value) {
    char text[11];
    char *at = text + 10;
    *at = 0;
    do *--at = (char)('0' + value % 10);
    while (value /= 10);
    mk_write(at);
}

void mk_write_hex(uint64_t value, int digits) {
    char text[17];
    text[digits] = 0;
    for (int i = digits - 1; i >= 0; i--, value >>= 4) text[i] = "0123456789abcdef"[value & 15];
    mk_write(text);
}

int mk_file_open(const char *path, mk_file_mode_t mode) {
    const block_t block = {address(path), (uintptr_t)mode, length(path)};
    return (int)mk_semihost_call(OPEN, block);
}

int mk_file_close(int handle) {
    const block_t block = {(uintptr_t)handle};
    return (int)mk_semihost_call(CLOSE, block);
}

/* Both calls return the number of bytes that are left over. */
static uint32_t transfer(uintptr_t operation, int handle, uintptr_t data, uint32_t size) {
    const block_t block = {(uintptr_t)handle, data, size};
    const intptr_t left = mk_semihost_call(operation, block);
    return left < 0 || (uint32_t)left > size ? 0 : size - (uint32_t)left;
}

uint32_t mk_file_read(int handle, void *to, uint32_t size) { return transfer(READ, handle, address(to), size); }

uint32_t mk_file_write(int handle, const void *from, uint32_t size) { return transfer(WRITE, handle, address(from), size); }

int mk_command_line(char *text, uint32_t size) {
    block_t block = {address(text), size};
    const int good = size > 0 && mk_semihost_call(COMMAND_LINE, block) == 0;
    if (!good && size > 0) text[0] = 0;
    return good && text[0] != 0;
}
