/* SPDX-License-Identifier: MIT */
#include "error.h"

#include <stdio.h>
#include <stdlib.h>

int mk_vfail(mk_error_t *error, const char *format, va_list arguments) {
    (void)vsnprintf(error->text, sizeof error->text, format, arguments);
    return 0;
}

int mk_fail(mk_error_t *error, const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    (void)mk_vfail(error, format, arguments);
    va_end(arguments);
    return 0;
}

void *mk_allocate(unsigned long count, unsigned long size) {
    void *memory = calloc(count ? count : 1, size ? size : 1);
    if (!memory) {
        (void)fprintf(stderr, "meshkal: out of memory (%lu x %lu bytes)\n", count, size);
        exit(1);
    }
    return memory;
}
