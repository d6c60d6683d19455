/* SPDX-License-Identifier: MIT */
/*
 * Test vectors of the library: calls with seeded random inputs and edge cases, written once and compiled for the host and for every target, in
 * the precision VECTOR_BITS. Whatever a call leaves behind is handed to the functions at the end, in an order that depends on nothing.
 * The host's program (vectors_write.c) writes it down; the image (vectors_compare.c) compares it, bit by bit. Inputs are drawn with integers and exact
 * operations, and are compared too, so that a difference says where it comes from.
 */
#ifndef FIRMWARE_VECTORS_H
#define FIRMWARE_VECTORS_H

#include <meshkal/unrolled.h>

/* After the kernels, which use these names themselves. */
#define MK_BITS VECTOR_BITS
#include <meshkal/real.h>

typedef enum { VECTORS_SHARED, VECTORS_UNROLLED } vectors_kernels_t;

/* All vectors of an image, through the kernels of the library or those unrolled for the vectors' dimensions (or what else its two passes differ
   in): both must tell the same. Given by vectors.c, vectors_unscented.c, vectors_duif.c, vectors_monitor.c or vectors_weighted.c. */
void vectors_run(vectors_kernels_t kernels);
/* What the passes are called. */
extern const char *const vectors_passes[2];

/* Part of vectors.c for meshkal/angle.h and meshkal/tracking.h. */
void vectors_models(void);

/* Drawn with splitmix64 and exact operations: vectors_draw.c. */
enum { VECTOR_STATES = 9 };
void draw_seed(uint64_t seed);
int draw_below(int count);
/* In [-1, 1), all digits of the precision. */
MK_REAL draw(void);
void draw_many(int count, MK_REAL size, MK_REAL *values);
/* 2^exponent */
MK_REAL power(int exponent);
/* P := size L L' with rows of L smaller by up to 2^-spread; n up to VECTOR_STATES. */
void draw_covariance(int n, int spread, MK_REAL size, MK_REAL *P);

/* Given by the program. What follows belongs to this vector: what it does, the dimensions, its number among those of that name. */
void vector_begin(const char *name, int n, int m, int slots, int number);
void vector_numbers(const char *what, int count, const MK_REAL *values);
void vector_word(const char *what, uint32_t value);
/* What the vectors must have come through, or they show less than they say: ends the program where it is not so. */
void vector_must(const char *what, int good);

#endif
