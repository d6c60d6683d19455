/* SPDX-License-Identifier: MIT */
/* The shared build: every function of the public headers, with dimensions known at run time and loops kept. */
#define MK_ROLLED
#include <meshkal/kernels.h>

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
    }
    return "MK_ERROR_UNKNOWN";
}

#define MK_BITS 32
#include "real.h"
#include "algebra/gamma_shared.tmpl.h"
#include "filter/rkfd_object.tmpl.h"
#undef MK_BITS

#define MK_BITS 64
#include "real.h"
#include "algebra/gamma_shared.tmpl.h"
#include "filter/rkfd_object.tmpl.h"
#undef MK_BITS
