/* SPDX-License-Identifier: MIT */
/* The risk sensitivity theta of a robust filter: the root of gamma(P, theta) = c (spec 1.2),

       gamma(P, theta) = log det(I - theta P) + tr[(I - theta P)^-1 - I].

   P is brought to tridiagonal form T once (Householder); each trial theta then costs O(n): the pivots of I - theta T,
   1 - E_k, and their derivatives follow from

       E_k = theta a_k + theta^2 b_{k-1}^2 / (1 - E_{k-1})            H = theta dE/dtheta     K = theta dH/dtheta

       gamma = sum_k  t_k - log(1 + t_k)  +  (H_k - E_k) / (1 - E_k),      t_k = E_k / (1 - E_k).

   Every term is positive, so gamma comes out to a few units of rounding at any theta below the pole 1 / lambda_max,
   however small c is or however the eigenvalues lie; no eigenvalue is computed. */

/* Tridiagonal form of packed S, which is overwritten: a (n) the diagonal, b2 (n, the last zero) the squared off-diagonal.
   S must be scaled to trace 1: columns with a norm below epsilon^1.5 are taken as zero. */
MK_PART void MK_F(mk_tridiagonal)(int n, MK_REAL *MK_RESTRICT S, MK_REAL *MK_RESTRICT a, MK_REAL *MK_RESTRICT b2) {
    /* Step k needs v and w above k only, where a and b2 are still free. */
    MK_REAL *const v = b2, *const w = a;
    MK_UNROLL for (int k = 0; k < n - 1; k++) {
        MK_REAL tail = MK_R(0.0);
        MK_UNROLL for (int i = k + 2; i < n; i++) {
            v[i] = S[MK_AT(i, k)];
            tail += v[i] * v[i];
        }
        const MK_REAL head = S[MK_AT(k + 1, k)], square = head * head + tail;
        a[k] = S[MK_AT(k, k)];
        b2[k] = square;
        if (tail > MK_EPSILON * MK_EPSILON * MK_EPSILON) {
            const MK_REAL norm = MK_F(mk_sqrt)(square);
            const MK_REAL size = head < MK_R(0.0) ? -head : head;
            /* H = I - tau v v', v = column + sign(head) norm e1 */
            const MK_REAL tau = MK_R(1.0) / (square + size * norm);
            v[k + 1] = head < MK_R(0.0) ? head - norm : head + norm;
            MK_REAL projection = MK_R(0.0);
            MK_UNROLL for (int i = k + 1; i < n; i++) {
                MK_REAL sum = MK_R(0.0);
                MK_UNROLL for (int j = k + 1; j < n; j++) sum += S[MK_PLACE(i, j)] * v[j];
                w[i] = tau * sum;
                projection += w[i] * v[i];
            }
            const MK_REAL half = MK_R(0.5) * tau * projection;
            MK_UNROLL for (int i = k + 1; i < n; i++) {
                w[i] -= half * v[i];
                MK_UNROLL for (int j = k + 1; j <= i; j++) S[MK_AT(i, j)] -= v[i] * w[j] + w[i] * v[j];
            }
        }
    }
    a[n - 1] = S[MK_AT(n - 1, n - 1)];
    b2[n - 1] = MK_R(0.0);
}

/* The same for P times 1 / trace, in work as MK_GAMMA_WORK lays it out: a behind MK_PACKED(n) numbers, b2 behind a.
   Returns 1 / trace, or 0 if P has no positive finite trace with a finite reciprocal. */
MK_PART MK_REAL MK_F(mk_scaled_tridiagonal)(int n, const MK_REAL *MK_RESTRICT P, MK_REAL *MK_RESTRICT work) {
    MK_REAL *const a = work + MK_AT(n, 0);
    const MK_REAL trace = MK_F(mk_trace)(n, P);
    const MK_REAL scale = MK_R(1.0) / trace;
    if (!(trace > MK_R(0.0) && scale > MK_R(0.0) && scale * MK_R(0.0) == MK_R(0.0))) return MK_R(0.0);
    MK_UNROLL for (int i = 0; i < MK_AT(n, 0); i++) work[i] = P[i] * scale;
    MK_F(mk_tridiagonal)(n, work, a, a + n);
    return scale;
}

/* gamma, slope = theta dgamma/dtheta and sum = sum of t_k at theta for tridiagonal (a, b2). Returns 0 at or beyond the pole. */
MK_KERNEL int MK_F(mk_gamma_tridiagonal)(int n, const MK_REAL *a, const MK_REAL *b2, MK_REAL theta, MK_REAL *gamma,
                                         MK_REAL *slope, MK_REAL *sum) {
    MK_REAL ratio = MK_R(0.0), h = MK_R(0.0), kappa = MK_R(0.0); /* 1 / (1 - E), H and K times it, of the row before */
    MK_REAL total = MK_R(0.0), product = MK_R(0.0), cross = MK_R(0.0), off = MK_R(0.0), rise = MK_R(0.0);
    int good = 1;
    MK_UNROLL for (int k = 0; k < n; k++) {
        const MK_REAL alpha = theta * a[k];
        const MK_REAL beta = k == 0 ? MK_R(0.0) : theta * theta * b2[k - 1] * ratio;
        const MK_REAL e = alpha + beta;
        const MK_REAL pivot = MK_R(1.0) - e;
        good &= pivot > MK_R(0.0);
        ratio = MK_R(1.0) / pivot;
        const MK_REAL excess = beta * (MK_R(1.0) + h);                                              /* H - E */
        const MK_REAL bend = beta * (MK_R(2.0) + (MK_R(3.0) + MK_R(2.0) * h) * h + kappa);         /* K - H */
        const MK_REAL t = e * ratio;
        h = t + excess * ratio;
        kappa = h + bend * ratio;
        off += excess * ratio;
        rise += bend * ratio + h * h;
        total += t;
        cross += product * t;              /* sum over i < j of t_i t_j and higher products */
        product += t + product * t;        /* 1 + product = product of all (1 + t) = 1 / det(I - theta T) */
    }
    /* sum t - log(1 + product): below 1 by the gap of the whole product less its cross terms, which keeps relative accuracy
       for one logarithm instead of n; above 1 nothing cancels. */
    if (product < MK_R(1.0)) *gamma = (MK_F(mk_log_gap)(product) - cross) + off;
    else *gamma = (total - MK_F(mk_log)(MK_R(1.0) + product)) + off;
    *slope = rise;
    *sum = total + off;
    return good && rise * MK_R(0.0) == MK_R(0.0);
}

/* The bending map: z(g) = v with v / (1 - v) = s + s^2/3 + s^3/36, s = sqrt(2 g). For one eigenvalue lambda it turns
   gamma(theta) into theta lambda up to a term of order s^4, so that Newton's method on z(k gamma(theta)) starts close and
   steps far. *derivative is dz/dg. */
MK_KERNEL MK_REAL MK_F(mk_gamma_unbend)(MK_REAL g, MK_REAL *derivative) {
    const MK_REAL s = MK_F(mk_sqrt)(MK_R(2.0) * g);
    const MK_REAL t = s * (MK_R(1.0) + s * (MK_R(0.33333333333333333) + s * MK_R(0.027777777777777778)));
    const MK_REAL scale = MK_R(1.0) / (MK_R(1.0) + t);
    const MK_REAL dt = MK_R(1.0) + s * (MK_R(0.66666666666666667) + s * MK_R(0.083333333333333333));
    *derivative = scale * scale * dt / s;
    return t * scale;
}

/* theta with gamma(P, theta) = c, 0 < c, P packed and positive definite; work: MK_PACKED(n) + 4 n numbers.
   Newton's method inside a bracket that never leaves [0, 1 / lambda_max): ends when a step is so small that the next would
   be below rounding. Returns the number of evaluations of gamma, or 0 without a root in this precision (c too small or too
   large, P not positive definite or not finite); *theta is then untouched. */
MK_KERNEL int MK_F(mk_inline_gamma_root)(int n, const MK_REAL *MK_RESTRICT P, MK_REAL c, MK_REAL *theta, MK_REAL *MK_RESTRICT work) {
    MK_REAL *const a = work + MK_AT(n, 0), *const b2 = a + n;
    const MK_REAL scale = MK_F(mk_scaled_tridiagonal)(n, P, work);
    /* Above 1 / epsilon the root is the pole. */
    if (!(c > MK_R(0.0) && c * MK_EPSILON < MK_R(1.0) && scale > MK_R(0.0))) return 0;

    /* p2 = tr T^2, p3 = tr T^3: the one-eigenvalue model p2 / mu^2 gamma(mu, theta) with mu = p3 / p2 meets gamma to third
       order in theta, and exactly for P = s I and for rank one. */
    MK_REAL p2 = MK_R(0.0), p3 = MK_R(0.0), largest = MK_R(0.0), before = MK_R(0.0);
    MK_UNROLL for (int k = 0; k < n; k++) {
        p2 += a[k] * a[k] + MK_R(2.0) * b2[k];
        p3 += a[k] * (a[k] * a[k] + MK_R(3.0) * (b2[k] + before));
        before = b2[k];
        if (a[k] > largest) largest = a[k];
    }
    const MK_REAL mu = p3 / p2, weight = mu * mu / p2;
    MK_REAL low = MK_R(0.0), high = MK_R(1.0) / largest, derivative;
    const MK_REAL target = MK_F(mk_gamma_unbend)(weight * c, &derivative);
    MK_REAL trial = target / mu;
    if (!(trial < high)) trial = MK_R(0.5) * high;
    for (int evaluations = 1; evaluations <= MK_GAMMA_LIMIT; evaluations++) {
        MK_REAL gamma, slope, sum, next;
        if (MK_F(mk_gamma_tridiagonal)(n, a, b2, trial, &gamma, &slope, &sum)) {
            const MK_REAL value = MK_F(mk_gamma_unbend)(weight * gamma, &derivative);
            const MK_REAL step = (target - value) / (derivative * weight * slope); /* relative to theta */
            const MK_REAL size = step < MK_R(0.0) ? -step : step;
            /* Near the pole a relative step of theta is one of 1 / (1 - theta lambda_max) <= 1 + sum in t. */
            if (size * (MK_R(1.0) + sum) < MK_GAMMA_CLOSE) {
                *theta = (trial + trial * step) * scale;
                return evaluations;
            }
            if (step > MK_R(0.0)) low = trial;
            else high = trial;
            next = trial + trial * step;
        } else {
            high = trial;
            next = high;
        }
        trial = next > low && next < high ? next : MK_R(0.5) * (low + high);
    }
    return 0;
}
