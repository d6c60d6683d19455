/* SPDX-License-Identifier: MIT */
/* The functions of <meshkal/angle.h>. Coefficients: minimax, fitted one after another to what the rounding of those before left. */

/* (sin(r) / r - 1) / z with z = r^2, |r| <= pi / 4. Relative error of 1 + z S below 4e-9 (f32), 4e-18 (f64). */
MK_KERNEL MK_REAL MK_F(mk_sin_tail)(MK_REAL z) {
#if MK_BITS == 64
    return -0.1666666666666663 + z * (0.0083333333333218407 + z * (-0.00019841269829358528 + z * (2.7557313538514035e-06 + z * (
           -2.5050734389164419e-08 + z * 1.5895433278767656e-10))));
#else
    return -0.166666552f + z * (0.00833218824f + z * -0.000195180954f);
#endif
}

/* (cos r - 1 + z / 2) / z^2. Relative error of the cosine below 2e-10 (f32), 6e-20 (f64). */
MK_KERNEL MK_REAL MK_F(mk_cos_tail)(MK_REAL z) {
#if MK_BITS == 64
    return 0.041666666666666595 + z * (-0.0013888888888873325 + z * (2.4801587288983675e-05 + z * (-2.7557314210071718e-07 + z * (
           2.0875704270295821e-09 + z * -1.1358683283696219e-11))));
#else
    return 0.0416666456f + z * (-0.00138873095f + z * 2.44323273e-05f);
#endif
}

/* (atan(q) / q - 1) / z with z = q^2, |q| <= tan(pi / 8). Relative error of 1 + z T below 7e-10 (f32), 3e-18 (f64). */
MK_KERNEL MK_REAL MK_F(mk_atan_tail)(MK_REAL z) {
#if MK_BITS == 64
    return -0.33333333333333198 + z * (0.19999999999953655 + z * (-0.1428571428019684 + z * (0.11111110783342724 + z * (
           -0.090908977532137475 + z * (0.076920601367035782 + z * (-0.066631033007847257 + z * (0.058478846884217728 + z * (
           -0.050392820968599698 + z * (0.038063702786054684 + z * -0.017905627690819183)))))))));
#else
    return -0.333333164f + z * (0.199985281f + z * (-0.14244391f + z * (0.105991669f + z * -0.06090042f)));
#endif
}

/* QUARTER: pi / 2 in four parts. The first three have 11 (f64: 26) bits: their products with whole numbers of 13 (27) bits are exact.
   WHOLE: 1.5 2^23 (2^52). Its unit in the last place is 1: a number added to it is rounded to a whole one, whose last bits are the sum's.
   LIMIT: below 2^22 (2^51) quarter turns, so that the sum does not leave that binade.
   EIGHTH: pi / 4 in two parts; twice, three and four times the first are exact. */
#if MK_BITS == 64
#define MK_QUARTER_1 1.5707963109016418
#define MK_QUARTER_2 1.5893254712295857e-08
#define MK_QUARTER_3 6.1232336011813492e-17
#define MK_QUARTER_4 3.9455541665632055e-24
#define MK_QUARTERS_IN_ONE 0.63661977236758138
#define MK_WHOLE 6755399441055744.0
#define MK_TURN_LIMIT 3.5e15
#define MK_BELOW_PI 3.1415926535897931
#define MK_EIGHTH_1 0.78539816339744828
#define MK_EIGHTH_2 3.061616997868383e-17
#else
#define MK_QUARTER_1 1.5703125f
#define MK_QUARTER_2 0.00048351287841796875f
#define MK_QUARTER_3 3.1385570764541626e-07f
#define MK_QUARTER_4 6.0771006282767104e-11f
#define MK_QUARTERS_IN_ONE 0.63661974668502808f
#define MK_WHOLE 12582912.0f
#define MK_TURN_LIMIT 6.5e6f
#define MK_BELOW_PI 3.1415925f
#define MK_EIGHTH_1 0.78539800643920898f
#define MK_EIGHTH_2 1.5695823663008923e-07f
#endif

/* x - k pi / 2 = result + *low, k a whole number. */
static MK_REAL MK_F(mk_less_quarters)(MK_REAL x, MK_REAL k, MK_REAL *low) {
    const MK_REAL most = x - k * MK_QUARTER_1 - k * MK_QUARTER_2; /* exact: the digits in front cancel */
    const MK_REAL third = k * MK_QUARTER_3, high = most - third, lost = (most - high) - third;
    const MK_REAL fourth = k * MK_QUARTER_4 - lost, result = high - fourth;
    *low = (high - result) - fourth;
    return result;
}

void MK_F(mk_sincos)(MK_REAL x, MK_REAL *sine, MK_REAL *cosine) {
    if (!(x > -MK_TURN_LIMIT && x < MK_TURN_LIMIT)) {
        *sine = *cosine = (MK_REAL)NAN;
        return;
    }
    const MK_REAL sum = x * MK_QUARTERS_IN_ONE + MK_WHOLE;
    MK_UINT quarters;
    memcpy(&quarters, &sum, sizeof quarters);
    MK_REAL low;
    const MK_REAL r = MK_F(mk_less_quarters)(x, sum - MK_WHOLE, &low);
    const MK_REAL z = r * r, h = MK_R(0.5) * z, w = MK_R(1.0) - h;
    MK_REAL s = r + (low * w + r * (z * MK_F(mk_sin_tail)(z)));
    MK_REAL c = w + (((MK_R(1.0) - w) - h) + (z * z * MK_F(mk_cos_tail)(z) - r * low));
    if (quarters & 1) {
        const MK_REAL t = s;
        s = c;
        c = -t;
    }
    *sine = quarters & 2 ? -s : s;
    *cosine = quarters & 2 ? -c : c;
}

MK_REAL MK_F(mk_wrap)(MK_REAL x) {
    if (x >= -MK_BELOW_PI && x <= MK_BELOW_PI) return x;
    if (!(x > -MK_TURN_LIMIT && x < MK_TURN_LIMIT)) return (MK_REAL)NAN;
    const MK_REAL sum = x * (MK_R(0.25) * MK_QUARTERS_IN_ONE) + MK_WHOLE;
    MK_REAL low, k = MK_R(4.0) * (sum - MK_WHOLE);
    const MK_REAL wrapped = MK_F(mk_less_quarters)(x, k, &low);
    /* Next to half a turn the rounding of x / 2 pi decides for k: the wrong way is found here. */
    if (wrapped >= -MK_BELOW_PI && wrapped <= MK_BELOW_PI) return wrapped;
    k += wrapped > MK_R(0.0) ? MK_R(4.0) : MK_R(-4.0);
    return MK_F(mk_less_quarters)(x, k, &low);
}

MK_REAL MK_F(mk_atan2)(MK_REAL y, MK_REAL x) {
    const MK_REAL height = y < MK_R(0.0) ? -y : y, width = x < MK_R(0.0) ? -x : x;
    const int steep = height > width;
    const MK_REAL large = steep ? height : width, small = steep ? width : height, sum = large + small;
    /* The angle is `eighths` pi / 4 plus or minus atan(q), |q| <= tan(pi / 8). */
    int eighths = 0, minus = 0;
    MK_REAL top = small, bottom = large;
    if (small > MK_R(0.41421356) * large) {
        eighths = 1;
        top = small - large;
        bottom = sum;
    }
    if (steep) {
        eighths = 2 - eighths;
        minus = 1;
    }
    if (x < MK_R(0.0)) {
        eighths = 4 - eighths;
        minus ^= 1;
    }
    /* The sum is infinite or NaN where top and bottom are, or overflow. */
    const MK_REAL q = top / bottom + MK_R(0.0) * sum, z = q * q, k = (MK_REAL)eighths;
    const MK_REAL tail = q * (z * MK_F(mk_atan_tail)(z)), high = k * MK_EIGHTH_1, low = k * MK_EIGHTH_2;
    const MK_REAL angle = minus ? high - (q + (tail - low)) : high + (q + (tail + low));
    return y < MK_R(0.0) ? -angle : angle;
}

#undef MK_QUARTER_1
#undef MK_QUARTER_2
#undef MK_QUARTER_3
#undef MK_QUARTER_4
#undef MK_QUARTERS_IN_ONE
#undef MK_WHOLE
#undef MK_TURN_LIMIT
#undef MK_BELOW_PI
#undef MK_EIGHTH_1
#undef MK_EIGHTH_2
