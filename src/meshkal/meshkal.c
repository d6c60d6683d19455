/* SPDX-License-Identifier: MIT */
/* The shared build: every function of the public headers, with dimensions known at run time and loops kept. */
#define MK_ROLLED
#include <meshkal/angle.h>
#include <meshkal/duif.h>
#include <meshkal/kernels.h>
#include <meshkal/extended.h>
#include <meshkal/monitor.h>
#include <meshkal/node.h>
#include <meshkal/quantile.h>
#include <meshkal/tracking.h>
#include <meshkal/unscented.h>

/* Times that an iterated filter halves its step. */
#define MK_HALVINGS 4

#include "integrity/rows.h"
#include "models/motion.h"
#include "network/frame.h"
#include "network/link.h"
#include "network/numbers.h"
#include "node/blob.h"
#include "node/record.h"
#include "statistics/quantile.h"

const char *mk_status_name(mk_status_t status) {
    switch (status) {
    case MK_OK: return "MK_OK";
    case MK_ERROR_ARGUMENT: return "MK_ERROR_ARGUMENT";
    case MK_ERROR_SHAPE: return "MK_ERROR_SHAPE";
    case MK_ERROR_NOT_FINITE: return "MK_ERROR_NOT_FINITE";
    case MK_ERROR_NOT_POSITIVE_DEFINITE: return "MK_ERROR_NOT_POSITIVE_DEFINITE";
    case MK_ERROR_TOLERANCE: return "MK_ERROR_TOLERANCE";
    case MK_ERROR_ORDER: return "MK_ERROR_ORDER";
    case MK_ERROR_REPEATED: return "MK_ERROR_REPEATED";
    case MK_ERROR_LENGTH: return "MK_ERROR_LENGTH";
    case MK_ERROR_VERSION: return "MK_ERROR_VERSION";
    case MK_ERROR_TYPE: return "MK_ERROR_TYPE";
    case MK_ERROR_CHECKSUM: return "MK_ERROR_CHECKSUM";
    case MK_ERROR_SECURITY: return "MK_ERROR_SECURITY";
    case MK_ERROR_MODEL: return "MK_ERROR_MODEL";
    case MK_ERROR_STRANGER: return "MK_ERROR_STRANGER";
    case MK_ERROR_REPLAYED: return "MK_ERROR_REPLAYED";
    case MK_ERROR_FORGED: return "MK_ERROR_FORGED";
    case MK_ERROR_LATE: return "MK_ERROR_LATE";
    case MK_ERROR_AHEAD: return "MK_ERROR_AHEAD";
    case MK_ERROR_IMPLAUSIBLE: return "MK_ERROR_IMPLAUSIBLE";
    case MK_ERROR_GATED: return "MK_ERROR_GATED";
    case MK_ERROR_DOMAIN: return "MK_ERROR_DOMAIN";
    case MK_STATUS_COUNT: break;
    }
    return "MK_ERROR_UNKNOWN";
}

#define MK_BITS 32
#include "shared.tmpl.h"
#undef MK_BITS

#define MK_BITS 64
#include "shared.tmpl.h"
#undef MK_BITS
