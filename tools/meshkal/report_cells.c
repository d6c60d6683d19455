/* SPDX-License-Identifier: MIT */
#include "report_cells.h"

#include <math.h>

void mk_print_cell(FILE *out, int width, int digits, double value) {
    if (isfinite(value)) (void)fprintf(out, " %*.*f", width, digits, value);
    else (void)fprintf(out, " %*s", width, "-");
}

const char *mk_nees_verdict(double nees, double low, double high) {
    if (isnan(nees)) return "-";
    return nees > high ? "over-confident" : nees < low ? "cautious" : "inside";
}
