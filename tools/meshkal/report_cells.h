/* SPDX-License-Identifier: MIT */
/* Cells of the tables that commands print. */
#ifndef MESHKAL_REPORT_CELLS_H
#define MESHKAL_REPORT_CELLS_H

#include <stdio.h>

/* A blank and the number; "-" if it is not finite. */
void mk_print_cell(FILE *out, int width, int digits, double value);
/* Of a NEES beside the band of an exact filter; "-" if it is not known. */
const char *mk_nees_verdict(double nees, double low, double high);

#endif
