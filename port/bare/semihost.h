/* SPDX-License-Identifier: MIT */
/* Semihosting for bare-metal images: console, files, command line and exit status of the debugger or emulator that runs them (Arm
   semihosting 2.0, taken over by RISC-V). Needs no C library and no memory. Without a debugger that listens, the first call traps. */
#ifndef MESHKAL_BARE_SEMIHOST_H
#define MESHKAL_BARE_SEMIHOST_H

#include <stdint.h>

/* Exit status of an image that an unexpected exception or interrupt ended. */
#define MK_EXIT_FAULT 99

/* What fopen calls rb, wb and ab. */
typedef enum { MK_FILE_READ = 1, MK_FILE_WRITE = 5, MK_FILE_APPEND = 9 } mk_file_mode_t;

/* The raw call, in start.S: one operation with its parameter block; its result. */
intptr_t mk_semihost_call(uintptr_t operation, const void *parameter);

/* Ends the emulation with this exit status (0 to 255), or hands control to the debugger. */
void mk_exit(int status) __attribute__((noreturn));

/* Text, a decimal number, the lowest `digits` (1 to 16) hexadecimal digits of a number: to the debugger's console. */
void mk_write(const char *text);
void mk_write_number(uint32_t value);
void mk_write_hex(uint64_t value, int digits);

/* A file of the host, path relative to the emulator's working directory: its handle, or -1. The handle is closed by mk_file_close,
   which returns 0 if all that was written is with the host. */
int mk_file_open(const char *path, mk_file_mode_t mode);
int mk_file_close(int handle);

/* Number of bytes read or written: fewer than `size` at the end of the file or on an error. */
uint32_t mk_file_read(int handle, void *to, uint32_t size);
uint32_t mk_file_write(int handle, const void *from, uint32_t size);

/* The command line, the program's name first: 1, or 0 if there is none or it has `size` characters or more; text is then "". */
int mk_command_line(char *text, uint32_t size);

#endif
