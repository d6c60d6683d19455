/* SPDX-License-Identifier: MIT */
/* Node objects whose dimensions are known at run time only, and configurations out of records (meshkal/record.h). */
#ifndef MESHKAL_HOST_NODE_H
#define MESHKAL_HOST_NODE_H

#include <meshkal/node.h>

#include "error.h"

/* What a host takes: every length is then an int, and an absurd one does not cost hours. */
#define MK_HOST_MOST_STATES 1024
#define MK_HOST_MOST_ROWS 255

/* The head of a configuration's content: dimensions, bits of a number, number of the node, model. The rest is not looked at. */
typedef struct {
    int n, m, slots, bits;
    uint16_t node;
    uint32_t model;
} mk_host_facts_t;

/* 1; or 0 and an error: too short, dimensions that no node has, a precision or flags that this version does not know, or a length that is
   not that of its dimensions. known: bytes of the content that are there, at most length; what a cut leaves. */
int mk_host_facts(const uint8_t *content, size_t known, size_t length, mk_host_facts_t *facts, mk_error_t *error);

#define MK_DECLARE_HOST_NODE(real)                                                                                            \
    /* The node object in one block, its scratch memory included: mk_node_..._real(h->n, h->m, h->slots, &h->view, ...). Not  \
       to be copied. */                                                                                                       \
    typedef struct {                                                                                                          \
        int n, m, slots;                                                                                                      \
        size_t frame_most, blob_most; /* bytes of a frame and of a saved state, at most */                                    \
        mk_node_view_##real##_t view;                                                                                         \
    } mk_host_node_##real##_t;                                                                                                \
    /* Memory for a node of these dimensions (n, m, slots >= 1 and within what the host takes), zeroed: start or restore comes next. \
       Free it. */                                                                                                            \
    mk_host_node_##real##_t *mk_host_node_open_##real(int n, int m, int slots);                                               \
    /* Are both, of one configuration, in the same place with the same numbers? Counters are not compared. */                 \
    int mk_host_node_equal_##real(const mk_host_node_##real##_t *a, const mk_host_node_##real##_t *b);                        \
    /* The configuration that an item CONFIGURATION holds, in one block with all its arrays: free it. Null and *error: see    \
       mk_host_facts, or of another precision. Numbers are judged by start and restore. */                                    \
    mk_node_config_##real##_t *mk_host_config_##real(const uint8_t *content, size_t length, mk_error_t *error);

MK_DECLARE_HOST_NODE(f32)
MK_DECLARE_HOST_NODE(f64)

#endif
