/* SPDX-License-Identifier: MIT */
#include "host_node.h"

#include <meshkal/network/bytes.h>
#include <stdlib.h>
#include <string.h>

/* The content of an item CONFIGURATION: see meshkal/record.h. */
enum { HEAD = 18, SLOT = 4, FLAG_INPUT = 1, FLAG_GATE = 2, FLAG_FOREIGN = 4, FLAG_STEADY = 8, FLAGS = 15 };

/* Bytes of the content; dimensions are below 2^16, so nothing overflows. */
static uint64_t content_length(const mk_host_facts_t *f, unsigned flags) {
    const uint64_t n = (uint64_t)f->n, m = (uint64_t)f->m, slots = (uint64_t)f->slots;
    const uint64_t numbers = n * n + 2 * MK_PACKED(n) + (flags & FLAG_INPUT ? 2 : 1) * n +
                             slots * (1 + 2 * m * n + MK_PACKED(n) + MK_PACKED(m)) + 1 +
                             (flags & FLAG_GATE ? slots + 1 : 0) + (flags & FLAG_FOREIGN ? 1 : 0) +
                             (flags & FLAG_STEADY ? n * n + slots * m * n + MK_PACKED(n) + 3 : 0);
    return HEAD + SLOT * slots + (flags & FLAG_STEADY ? 2 : 0) + (uint64_t)(f->bits / 8) * numbers;
}

int mk_host_facts(const uint8_t *content, size_t known, size_t length, mk_host_facts_t *facts, mk_error_t *error) {
    mk_host_facts_t f;
    memset(&f, 0, sizeof f);
    if (length < HEAD + SLOT) return mk_fail(error, "a configuration of %zu bytes", length);
    if (known < HEAD + SLOT) return mk_fail(error, "the configuration is cut");
    f.n = mk_get_u16(content);
    f.m = mk_get_u16(content + 2);
    f.slots = mk_get_u16(content + 4);
    f.bits = content[10];
    f.model = mk_get_u32(content + 14);
    f.node = mk_get_u16(content + HEAD);
    const unsigned flags = content[13];
    if (f.n < 1 || f.n > MK_HOST_MOST_STATES || f.m < 1 || f.m > MK_HOST_MOST_ROWS || f.slots < 1)
        return mk_fail(error, "a configuration of %d states, %d rows, %d slots; 1 to %d, 1 to %d and 1 or more can be run", f.n, f.m,
                       f.slots, MK_HOST_MOST_STATES, MK_HOST_MOST_ROWS);
    if (f.bits != 32 && f.bits != 64) return mk_fail(error, "numbers of %d bits; 32 and 64 are known", f.bits);
    if (flags & ~(unsigned)FLAGS)
        return mk_fail(error, "the configuration has parts that this version does not know (flags 0x%02x)", flags);
    if (content_length(&f, flags) != length)
        return mk_fail(error, "a configuration of %zu bytes; its %d states, %d rows and %d slots take %llu", length, f.n, f.m, f.slots,
                       (unsigned long long)content_length(&f, flags));
    *facts = f;
    return 1;
}

#define MK_BITS 32
#include <meshkal/real.h>
#include "host_node.tmpl.h"
#undef MK_BITS

#define MK_BITS 64
#include <meshkal/real.h>
#include "host_node.tmpl.h"
#undef MK_BITS
