/* SPDX-License-Identifier: MIT */
/* meshkal/gate.h. */

/* Puts d2 and the test ratio on record. */
static MK_REAL MK_F(mk_gate_rate)(MK_REAL threshold, MK_REAL d2, MK_F_T(mk_gate_record) * record) {
    record->d2 = d2 <= MK_LARGEST ? d2 : MK_LARGEST;
    const MK_REAL ratio = threshold > MK_R(0.0) ? record->d2 / threshold : MK_R(0.0);
    record->ratio = ratio <= MK_LARGEST ? ratio : MK_LARGEST;
    return record->ratio;
}

/* Counts a reading that is used with this factor on its variance, or not at all. */
static void MK_F(mk_gate_count)(MK_REAL factor, MK_F_T(mk_gate_record) * record) {
    record->accepted += factor == MK_R(1.0);
    record->inflated += factor > MK_R(1.0);
    record->rejected += !(factor > MK_R(0.0));
    record->since_accepted = factor == MK_R(1.0) ? 0 : record->since_accepted + 1;
}

MK_REAL MK_F(mk_gate_judge)(int policy, MK_REAL threshold, MK_REAL d2, MK_F_T(mk_gate_record) * record) {
    const MK_REAL ratio = MK_F(mk_gate_rate)(threshold, d2, record);
    const MK_REAL factor = ratio <= MK_R(1.0) ? MK_R(1.0) : policy == MK_GATE_INFLATE ? ratio : MK_R(0.0);
    MK_F(mk_gate_count)(factor, record);
    return factor;
}

mk_status_t MK_F(mk_gate_thresholds)(double tail, int count, MK_REAL *threshold) {
    if (!threshold || !(tail > 0.0 && tail < 1.0)) return MK_ERROR_ARGUMENT;
    for (int i = 0; i < count; i++) threshold[i] = (MK_REAL)mk_chi2_quantile(tail, (double)(i + 1));
    return MK_OK;
}

/* What start says of a gate: thresholds are numbers that are not negative, for `rows` rows of a sensor and `most` together; the policy is one of those
   there are. */
static mk_status_t MK_F(mk_gate_check)(const MK_F_T(mk_gate) * gate, int rows, int most) {
    for (int i = 0; i < most; i++) {
        const MK_REAL single = gate->sensor && i < rows ? gate->sensor[i] : MK_R(0.0), stacked = gate->stacked ? gate->stacked[i] : MK_R(0.0);
        if (!(single * MK_R(0.0) == MK_R(0.0) && stacked * MK_R(0.0) == MK_R(0.0))) return MK_ERROR_NOT_FINITE;
        if (single < MK_R(0.0) || stacked < MK_R(0.0)) return MK_ERROR_ARGUMENT;
    }
    return gate->policy > MK_GATE_INFLATE ? MK_ERROR_ARGUMENT : MK_OK;
}
