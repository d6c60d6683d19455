/* SPDX-License-Identifier: MIT */
#include "object.h"

#include <math.h>
#include <meshkal/inline.h>
#include <meshkal/quantile.h>
#include <stdlib.h>
#include <string.h>

#include "host_node.h"
#include "scenario_read.h"

#define MK_BITS 32
#include <meshkal/real.h>
#define MK_REAL_NAME "float32"
#define MK_NETWORK mk_network_f32
#include "object.tmpl.h"
#undef MK_NETWORK
#undef MK_REAL_NAME
#undef MK_BITS

#define MK_BITS 64
#include <meshkal/real.h>
#define MK_REAL_NAME "float64"
#define MK_NETWORK mk_network_f64
#include "object.tmpl.h"
