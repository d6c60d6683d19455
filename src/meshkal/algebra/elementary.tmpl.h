/* SPDX-License-Identifier: MIT */
/* Logarithms and exponentials built from exact operations, so that every target gives the same bits. */

/* R(z) with atanh(s) = s (1 + z R(z)), z = s^2, on 0 <= z <= 0.04. Interpolated at Chebyshev nodes; relative error of
   1 + z R below 2e-18 (f64), 3e-8 (f32). */
MK_KERNEL MK_REAL MK_F(mk_atanh_tail)(MK_REAL z) {
#if MK_BITS == 64
    const double z2 = z * z, z4 = z2 * z2;
    const double low = (0.33333333333333332089 + 0.20000000000003970521 * z) + (0.14285714283637967299 + 0.11111111524175794031 * z) * z2;
    const double high = (0.090908688131514685838 + 0.076944339028068583135 * z) + (0.066048541210297316303 + 0.068045151314292493252 * z) * z2;
    return low + high * z4;
#else
    return 0.33333356868100676713f + (0.19989455053961159682f + 0.14979598367082414791f * z) * z;
#endif
}

/* Natural logarithm of a positive finite normal x; error below 1 ulp or so. Subnormal x is scaled first. */
MK_KERNEL MK_REAL MK_F(mk_log)(MK_REAL x) {
#if MK_BITS == 64
    uint64_t bits;
    int64_t exponent = 0;
    if (x < DBL_MIN) {
        x *= 18014398509481984.0; /* 2^54 */
        exponent = -54;
    }
    memcpy(&bits, &x, sizeof bits);
    /* Mantissa into [sqrt(1/2), sqrt(2)): subtract the bits of sqrt(1/2), keep the exponent of what is left. */
    const uint64_t shift = bits - UINT64_C(0x3fe6a09e667f3bcd);
    exponent += (int64_t)shift >> 52;
    bits -= shift & UINT64_C(0xfff0000000000000);
    /* 0x1.62e42fefa38p-1 and 0x1.ef35793c7673p-45: C++ before 2017 has no hexadecimal constants. */
    const double ln2_high = 0.6931471805598903, ln2_low = 5.497923018708371e-14;
#else
    uint32_t bits;
    int32_t exponent = 0;
    if (x < FLT_MIN) {
        x *= 33554432.0f; /* 2^25 */
        exponent = -25;
    }
    memcpy(&bits, &x, sizeof bits);
    const uint32_t shift = bits - UINT32_C(0x3f3504f3);
    exponent += (int32_t)shift >> 23;
    bits -= shift & UINT32_C(0xff800000);
    /* 0x1.62e4p-1 and 0x1.7f7d1cp-20 */
    const float ln2_high = 0.693145751953125f, ln2_low = 1.428606765330187e-06f;
#endif
    MK_REAL mantissa;
    memcpy(&mantissa, &bits, sizeof mantissa);
    const MK_REAL k = (MK_REAL)exponent;
    const MK_REAL d = mantissa - MK_R(1.0); /* exact */
    const MK_REAL s = d / (MK_R(2.0) + d);
    const MK_REAL z = s * s;
    /* log(1 + d) = d - s (d - 2 z R): d is exact, so the rounding of s does not reach the leading digits. */
    return k * ln2_high + (d - (s * (d - MK_R(2.0) * z * MK_F(mk_atanh_tail)(z)) - k * ln2_low));
}

/* t - log(1 + t) for t >= 0, without cancellation: relative error of a few units of rounding however small t is.
   s = t / (2 + t), which some callers have sooner than t: log(1 + t) = 2 atanh(s) = 2 s (1 + z R). */
MK_KERNEL MK_REAL MK_F(mk_log_gap_quotient)(MK_REAL t, MK_REAL s) {
    if (t <= MK_R(0.5)) {
        const MK_REAL z = s * s;
        return s * (t - MK_R(2.0) * z * MK_F(mk_atanh_tail)(z));
    }
#ifdef MK_NARROW
    return MK_F(mk_log_gap_far)(t);
#else
    return t - MK_F(mk_log)(MK_R(1.0) + t);
#endif
}

MK_KERNEL MK_REAL MK_F(mk_log_gap)(MK_REAL t) { return MK_F(mk_log_gap_quotient)(t, t / (MK_R(2.0) + t)); }

/* exp(x); error about 1 ulp, for a subnormal result half a unit of it more. 0 or infinity beyond the range; NaN gives NaN. */
MK_KERNEL MK_REAL MK_F(mk_exp)(MK_REAL x) {
#if MK_BITS == 64
    const double ln2_high = 0.6931471805598903, ln2_low = 5.497923018708371e-14, lowest = -746.0, highest = 710.0;
#else
    const float ln2_high = 0.693145751953125f, ln2_low = 1.428606765330187e-06f, lowest = -104.0f, highest = 89.0f;
#endif
    if (!(x > lowest)) return x <= lowest ? MK_R(0.0) : x;
    if (x > highest) return (MK_REAL)INFINITY;
    /* x = k log 2 + high - low, |high - low| <= log(2) / 2; k log 2 rounded so that the product is exact. */
    const int k = (int)(x * MK_R(1.4426950408889634074) + (x < MK_R(0.0) ? MK_R(-0.5) : MK_R(0.5))), half = k / 2;
    const MK_REAL high = x - (MK_REAL)k * ln2_high, low = (MK_REAL)k * ln2_low, r = high - low, z = r * r;
    /* exp(r) = 1 + r + r c / (2 - c), c = r - z S(z), 2 + z S(z) = r coth(r / 2). S is interpolated at Chebyshev nodes. */
#if MK_BITS == 64
    const double c = r - z * (0.1666666666666666152 + z * (-0.0027777777777563719179 + z * (6.6137564712823276512e-5 +
                              z * (-1.6534059505063118069e-6 + z * 4.1437411422744638435e-8))));
    const uint64_t first = (uint64_t)(1023 + half) << 52, second = (uint64_t)(1023 + k - half) << 52;
#else
    const float c = r - z * (0.16666654751384682391f + z * -0.0027698466956880178942f);
    const uint32_t first = (uint32_t)(127 + half) << 23, second = (uint32_t)(127 + k - half) << 23;
#endif
    MK_REAL power, rest;
    memcpy(&power, &first, sizeof power);
    memcpy(&rest, &second, sizeof rest);
    return (MK_R(1.0) + (high - (low - r * c / (MK_R(2.0) - c)))) * power * rest;
}
