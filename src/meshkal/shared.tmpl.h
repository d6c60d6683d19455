/* SPDX-License-Identifier: MIT */
/* All that is compiled once in one precision, lowest layer first. */
#include "real.h"
#include "algebra/gamma_shared.tmpl.h"
#include "filter/rkfd_object.tmpl.h"
#include "filter/gate.tmpl.h"
#include "filter/unscented_update.tmpl.h"
#include "filter/unscented_object.tmpl.h"
#include "network/numbers.tmpl.h"
#include "node/record.tmpl.h"
#include "node/node.tmpl.h"
#include "node/steps.tmpl.h"
#include "node/blob.tmpl.h"
