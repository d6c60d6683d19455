/* SPDX-License-Identifier: MIT */
/* What the library is compared with: the definitions of spec 1.1 to 1.4 written out in double precision with LAPACK. V is carried,
   the measurements that arrived are stacked, matrices are inverted where the formula says so, theta comes from the eigenvalues.
   Slow and plain on purpose; shares no code and no algorithm with src/meshkal. Matrices are full, in row order. */
#ifndef UNIT_REFERENCE_H
#define UNIT_REFERENCE_H

#define LARGEST_N 17
#define LARGEST_M 3
#define LARGEST_SLOTS 6
#define LARGEST_STACK (LARGEST_M * LARGEST_SLOTS)

/* What one node knows. C and R of a sensor: rows x n and rows x rows, dense. */
typedef struct {
    int n, m, slots;
    int rows[LARGEST_SLOTS];
    double A[LARGEST_N * LARGEST_N], Q[LARGEST_N * LARGEST_N];
    double r[LARGEST_N], x0[LARGEST_N], P0[LARGEST_N * LARGEST_N];
    double weight[LARGEST_SLOTS];
    double C[LARGEST_SLOTS][LARGEST_M * LARGEST_N], R[LARGEST_SLOTS][LARGEST_M * LARGEST_M];
    double tolerance;
} model_t;

typedef struct {
    double x[LARGEST_N], psi[LARGEST_N];
    double V[LARGEST_N * LARGEST_N], P[LARGEST_N * LARGEST_N];
    double theta, nis, square; /* innovations' square in the metric of C V C' + R and of R */
    int nis_rows;
} reference_t;

/* result := S^-1 of a symmetric positive definite S. Ends the test program if S is not. */
void reference_inverse(int n, const double *S, double *result);

/* Eigenvalues of symmetric S, ascending. */
void reference_eigenvalues(int n, const double *S, double *eigenvalues);

/* gamma at theta from the eigenvalues of P, and theta dgamma/dtheta where slope is not null. */
double reference_gamma(int n, const double *eigenvalues, double theta, double *slope);

/* The root of gamma(P, theta) = c by bisection down to neighbouring numbers; 0 for c = 0. */
double reference_theta(int n, const double *P, double c);

void reference_start(const model_t *model, reference_t *state);

/* y[l] null: nothing arrived from slot l. input null: the model's. */
void reference_incremental(const model_t *model, reference_t *state, const double *const *y, const double *input, double c);

/* psi[l] null: nothing arrived from slot l; psi[0] is not read, the node's own is. */
void reference_diffuse(const model_t *model, reference_t *state, const double *const *psi);

/* C V C' + R of one sensor, rows x rows. */
void reference_variance(const model_t *model, const reference_t *state, int slot, double *result);

/* The same of all sensors that arrived together, and y - C x; returns the rows. */
int reference_innovations(const model_t *model, const reference_t *state, const double *const *y, double *e, double *result);

/* One step of the textbook Kalman filter in gain form, x and V from one prediction to the next. */
void reference_kalman(const model_t *model, const double *const *y, const double *input, double *x, double *V);

/* Largest |a - b| over the larger of `floor` and the largest |b|. Infinite if any a is not finite. */
double relative_error(int count, const double *a, const double *b, double floor);

/* Full symmetric n x n to packed and back. */
void pack(int n, const double *full, double *packed);
void unpack(int n, const double *packed, double *full);

#endif
