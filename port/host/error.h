/* SPDX-License-Identifier: MIT */
/* Error texts of the host programs: one message, kept until it is printed. */
#ifndef MESHKAL_HOST_ERROR_H
#define MESHKAL_HOST_ERROR_H

#include <stdarg.h>

typedef struct {
    char text[1024];
} mk_error_t;

#if defined(__GNUC__) || defined(__clang__)
#define MK_PRINTF(text, first) __attribute__((__format__(__printf__, text, first)))
#else
#define MK_PRINTF(text, first)
#endif

/* Writes the message and returns 0, so that a failing function ends with: return mk_fail(error, ...). */
int mk_fail(mk_error_t *error, const char *format, ...) MK_PRINTF(2, 3);
int mk_vfail(mk_error_t *error, const char *format, va_list arguments);

/* Memory or the end: a host program cannot go on without it. Sizes are count times size, checked; zeroed. */
void *mk_allocate(unsigned long count, unsigned long size);

#endif
