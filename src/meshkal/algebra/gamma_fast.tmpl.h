/* SPDX-License-Identifier: MIT */
/* The root of gamma(P, theta) = c for n <= 6 from the characteristic polynomial instead of the spectrum.

   D(theta) = det(I - theta P) = sum_k (-1)^k e_k theta^k. e_1..e_3 follow from the power sums p_k = tr P^k by Newton's
   identities, e_4..e_6 from det P and P^-1, which the filter step needs anyway. With t_i = theta lambda_i / (1 - theta
   lambda_i), the elementary symmetric sums of the t_i are E_k = (-theta)^k D^(k) / (k! D), and

       gamma = [t - log(1 + t)] + sum_k (-1)^(k-1) (k-1) e_k theta^k / D,       t = 1/D - 1,

   a form that keeps relative accuracy as c goes to 0. It is a fast path only: e_4..e_6 lose accuracy with the condition
   number of P, and D with large c, so the rounding error is bounded at the root and the result is given up where the bound
   is too large. */

/* What is known before the inverse: sums for P / trace P, and the first guess of theta times the trace, which is
   guess + lift e4. */
typedef struct {
    MK_REAL trace, scale, e2, e3, guess, lift;
} MK_F_T(mk_gamma_start);

MK_KERNEL void MK_F(mk_gamma_fast_start)(int n, const MK_REAL *MK_RESTRICT P, MK_REAL c, MK_F_T(mk_gamma_start) * start) {
    const MK_REAL trace = MK_F(mk_trace)(n, P), scale = MK_R(1.0) / trace, scale2 = scale * scale;
    /* tr P^2 and tr P^3 over i > j > k: six equal terms with three indices, three with two. Sums by rows keep the chains of
       additions short. */
    MK_REAL on2 = MK_R(0.0), on3 = MK_R(0.0), off2 = MK_R(0.0), off3 = MK_R(0.0);
    MK_UNROLL for (int i = 0; i < n; i++) {
        const MK_REAL diagonal = P[MK_AT(i, i)];
        MK_REAL row2 = MK_R(0.0), row3 = MK_R(0.0);
        MK_UNROLL for (int j = 0; j < i; j++) {
            MK_REAL sum = P[MK_AT(i, j)] * (diagonal + P[MK_AT(j, j)]);
            MK_UNROLL for (int k = 0; k < j; k++) sum += MK_R(2.0) * P[MK_AT(i, k)] * P[MK_AT(j, k)];
            row2 += P[MK_AT(i, j)] * P[MK_AT(i, j)];
            row3 += P[MK_AT(i, j)] * sum;
        }
        off2 += row2;
        off3 += row3;
        on2 += diagonal * diagonal;
        on3 += diagonal * diagonal * diagonal;
    }
    const MK_REAL p2 = (on2 + MK_R(2.0) * off2) * scale2, p3 = (on3 + MK_R(3.0) * off3) * (scale2 * scale);
    const MK_REAL e2 = MK_R(0.5) * (MK_R(1.0) - p2);
    const MK_REAL e3 = n < 3 ? MK_R(0.0) : MK_R(0.16666666666666667) * (MK_R(1.0) - MK_R(3.0) * p2 + MK_R(2.0) * p3);

    /* The one-eigenvalue model with mu = p3 / p2, whose root in t is s + s^2/3 + s^3/36.., s^2 = 2 c mu^2 / p2, corrected
       for the p4 = p3 + e3 - e2 p2 - 4 e4 that the model gets wrong. */
    const MK_REAL p2_inverse = MK_R(1.0) / p2;
    const MK_REAL mu = p3 * p2_inverse;
    const MK_REAL sigma = MK_F(mk_sqrt)(MK_R(2.0) * c * p2_inverse);
    const MK_REAL s = sigma * mu;
    const MK_REAL bend = MK_R(1.0) + s * (MK_R(0.33333333333333333) + s * MK_R(0.027777777777777778));
    const MK_REAL u = sigma * bend / (MK_R(1.0) + s * bend), u3 = u * u * u;
    start->trace = trace;
    start->scale = scale;
    start->e2 = e2;
    start->e3 = e3;
    start->guess = u - MK_R(0.75) * ((p3 + e3) * p2_inverse - e2 - mu * mu) * u3;
    start->lift = MK_R(3.0) * p2_inverse * u3;
}

/* 1 / det(P / trace) from the factor L of P. */
MK_KERNEL MK_REAL MK_F(mk_gamma_pivots)(int n, const MK_REAL *MK_RESTRICT L, MK_REAL trace) {
    MK_REAL product = MK_R(1.0);
    MK_UNROLL for (int i = 0; i < n; i++) product *= L[MK_AT(i, i)] * trace;
    return product;
}

/* theta for 1 <= n <= 6 and c > 0; pivots as above, inverse P^-1. Returns the number of evaluations of gamma, or 0
   when the root is not certain to MK_FAST_ERROR (relative): use mk_gamma_root. *theta is then untouched. */
MK_KERNEL int MK_F(mk_gamma_fast_root)(int n, const MK_F_T(mk_gamma_start) * start, MK_REAL pivots,
                                       const MK_REAL *MK_RESTRICT inverse, MK_REAL c, MK_REAL *theta) {
    const MK_REAL trace = start->trace, e2 = start->e2, e3 = start->e3;
    /* error4: what an error of P^-1 of relative size 1 would do to e4. */
    MK_REAL e4 = MK_R(0.0), e5 = MK_R(0.0), e6 = MK_R(0.0), error4 = MK_R(0.0), condition = MK_R(1.0);
    if (n >= 4) {
        const MK_REAL determinant = MK_R(1.0) / pivots;
        const MK_REAL q1 = MK_F(mk_trace)(n, inverse) * trace;
        condition = q1;
        if (n == 4) error4 = e4 = determinant;
        if (n == 5) error4 = e4 = determinant * q1, e5 = determinant;
        if (n == 6) {
            MK_REAL off = MK_R(0.0), on = MK_R(0.0);
            MK_UNROLL for (int i = 0; i < n; i++) {
                MK_REAL row = MK_R(0.0);
                MK_UNROLL for (int j = 0; j < i; j++) row += inverse[MK_AT(i, j)] * inverse[MK_AT(i, j)];
                off += row;
                on += inverse[MK_AT(i, i)] * inverse[MK_AT(i, i)];
            }
            const MK_REAL q2 = (on + MK_R(2.0) * off) * (trace * trace);
            e4 = MK_R(0.5) * determinant * (q1 * q1 - q2);
            error4 = determinant * (q1 * q1);
            e5 = determinant * q1;
            e6 = determinant;
        }
    }
    MK_REAL u = start->guess + start->lift * e4; /* theta times trace */
    for (int evaluations = 1; evaluations <= 3; evaluations++) {
        /* Powers instead of Horner's rule: shorter chains of dependent operations. */
        const MK_REAL u2 = u * u, u4 = u2 * u2;
        const MK_REAL a2 = e2 * u2, a3 = e3 * (u2 * u), a4 = e4 * u4, a5 = e5 * (u4 * u), a6 = e6 * (u4 * u2);
        const MK_REAL drop = ((u - a2) + (a3 - a4)) + (a5 - a6); /* 1 - D */
        const MK_REAL D = MK_R(1.0) - drop;
        if (!(D > MK_R(0.0))) return 0;
        const MK_REAL D_inverse = MK_R(1.0) / D;
        const MK_REAL tail = ((MK_R(2.0) * a3 - a2) + (MK_R(4.0) * a5 - MK_R(3.0) * a4)) - MK_R(5.0) * a6;
        /* t / (2 + t) does not wait for the division behind t. */
        const MK_REAL quotient = drop / (MK_R(2.0) - drop);
        const MK_REAL E1 = (((u - MK_R(2.0) * a2) + (MK_R(3.0) * a3 - MK_R(4.0) * a4)) + (MK_R(5.0) * a5 - MK_R(6.0) * a6)) * D_inverse;
        const MK_REAL E2 = (((a2 - MK_R(3.0) * a3) + (MK_R(6.0) * a4 - MK_R(10.0) * a5)) + MK_R(15.0) * a6) * D_inverse;
        const MK_REAL E3 = ((a3 - MK_R(4.0) * a4) + (MK_R(10.0) * a5 - MK_R(20.0) * a6)) * D_inverse;
        /* Power sums of the t_i: T2 = theta gamma', T2 + 2 T3 = theta^2 gamma''. Halley's step relative to theta, with
           1 / (1 + y) as 1 - y + y^2 so that no division waits for gamma. */
        const MK_REAL T2 = E1 * E1 - MK_R(2.0) * E2;
        const MK_REAL T3 = E1 * (E1 * E1 - MK_R(3.0) * E2) + MK_R(3.0) * E3;
        const MK_REAL T2_inverse = MK_R(1.0) / T2;
        const MK_REAL bend = MK_R(0.5) + T3 * T2_inverse;
        const MK_REAL gap = MK_F(mk_log_gap_quotient)(drop * D_inverse, quotient); /* may call: late, when little is waiting */
        const MK_REAL newton = ((c - tail * D_inverse) - gap) * T2_inverse;
        const MK_REAL y = newton * bend;
        const MK_REAL step = newton * (MK_R(1.0) - y + y * y);
        u += u * step;
        /* Halley leaves about a third of the cube of the step, which 1 + E1 >= 1 / (1 - theta lambda_max) magnifies. */
        const MK_REAL reach = (step < MK_R(0.0) ? -step : step) * (MK_R(1.0) + E1);
        if (reach < MK_FAST_CLOSE) {
            const MK_REAL product = drop * D_inverse;
            const MK_REAL loss = MK_R(8.0) * MK_EPSILON *
                                 (product * (MK_R(1.0) + product) * u +
                                  condition * D_inverse * (MK_R(3.0) * error4 * u4 + MK_R(4.0) * a5 + MK_R(5.0) * a6));
            if (!(loss < MK_FAST_ERROR * T2 && u > MK_R(0.0))) return 0;
            *theta = u * start->scale;
            return evaluations;
        }
    }
    return 0;
}
