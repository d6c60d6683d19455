/* SPDX-License-Identifier: MIT */
/* Filter types of all kinds of dimensions, in one REAL: included once for each. */
#define TAG least
#define N 1
#define M 1
#define SLOTS 1
#include "unscented_typed.tmpl.h"
#define TAG wide
#define N 2
#define M 3
#define SLOTS 2
#include "unscented_typed.tmpl.h"
#define TAG tracker
#define N 4
#define M 2
#define SLOTS 3
#include "unscented_typed.tmpl.h"
#define TAG many
#define N 6
#define M 1
#define SLOTS 4
#include "unscented_typed.tmpl.h"
#define TAG tall
#define N 3
#define M 4
#define SLOTS 1
#include "unscented_typed.tmpl.h"
