/* SPDX-License-Identifier: MIT */
/* Names in templates that are compiled for several node types: V(name) is a name of its own, UNIT(function) a function of the node type. */
#ifndef UNIT_NODE_NAMES_H
#define UNIT_NODE_NAMES_H

#include <meshkal/node.h>
#include <meshkal/unrolled.h>

#include "precision.h"
#include "wire.h"

#define MK_NODE_OF(name, real, n, m, slots) MK_NODE(name, real, n, m, slots)
#define MK_NODE_UNROLLED_OF(name, real, n, m, slots) MK_NODE_UNROLLED(name, real, n, m, slots)
#define V(name) JOIN(JOIN(name##_, KIND), JOIN(_, PRECISION))
#define UNIT(function) JOIN(V(unit), _##function)
#define MK(name) JOIN(name##_, PRECISION)
#define MK_T(name) JOIN(MK(name), _t)

enum { N = 3, M = 2, SLOTS = 4, MODEL = 0x2b5c81e7 };

#endif
