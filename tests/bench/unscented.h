/* SPDX-License-Identifier: MIT */
/* What the programs that compare unscented and extended filters share: scenes, and the interface behind which every implementation stands.

   A step is a prediction over dt, three readings, an update. Targets of constant velocity, [p, v] for each axis; the filter starts anew every
   SCENE_STEPS steps, as its readings do. */
#ifndef UNSCENTED_H
#define UNSCENTED_H

#ifdef __cplusplus
extern "C" {
#endif

#define SCENE_STEPS 64
#define SCENE_N 6
#define SCENE_ROWS 3
#define SCENE_PACKED(n) ((n) * ((n) + 1) / 2)

typedef struct {
    const char *name;
    int n, bearings; /* 1: bearings instead of ranges */
    double dt, position[SCENE_ROWS][3], x0[SCENE_N], P0[SCENE_PACKED(SCENE_N)], Q[SCENE_PACKED(SCENE_N)], variance, z[SCENE_STEPS][SCENE_ROWS];
} scene_t;

/* Julier's sigma points (kappa = 3 - n), the scaled ones (the alpha and beta below, the same kappa), extended, MPUKF with 5 and 30 increments,
   IUKF with up to 5 steps. */
enum { FILTER_JULIER, FILTER_SCALED, FILTER_EXTENDED, FILTER_PROGRESSIVE_5, FILTER_PROGRESSIVE_30, FILTER_ITERATED, FILTERS };
#define SCENE_ALPHA 0.5
#define SCENE_BETA 2.0

typedef struct {
    const char *name;
    int n, bits;
    int (*start)(const scene_t *scene, int filter); /* 1, or 0 if it does not have this filter */
    int (*run)(int steps);                          /* so many steps; 1, or 0 on failure */
    void (*read)(double *x, double *P);             /* of the last step; P packed */
} contender_t;

const contender_t *scene_meshkal(int *count);
const contender_t *scene_eigen(int *count);

#ifdef __cplusplus
}
#endif

#endif
