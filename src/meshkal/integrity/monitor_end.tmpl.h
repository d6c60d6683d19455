/* SPDX-License-Identifier: MIT */
/* When is it over: meshkal/monitor.h, MK_MONITOR_EXCLUDE. */

mk_status_t MK_F(mk_monitor_evidence)(double early, double epochs, MK_REAL *evidence) {
    if (!evidence || !(early > 0.0 && early < 1.0) || !(epochs >= 1.0 && epochs <= 1e300)) return MK_ERROR_ARGUMENT;
    *evidence = (MK_REAL)(mk_log_f64(epochs) - mk_log_f64(early));
    return MK_OK;
}

/* The fault has these levels, in the other ones of m rows none, and an unknown slope that has not carried it far within a window. */
static void MK_F(mk_fault_begin)(int window, int m, int rows, const MK_REAL *level, MK_F_T(mk_fault) * fault) {
    for (int i = 0; i < m; i++) {
        fault[i].level = i < rows ? level[i] : MK_R(0.0);
        fault[i].slope = MK_R(0.0);
        fault[i].P[0] = MK_R(1.0);
        fault[i].P[1] = MK_R(0.0);
        fault[i].P[2] = MK_R(1.0) / ((MK_REAL)window * (MK_REAL)window);
        fault[i].sum = MK_R(0.0);
    }
}

/* An epoch goes by. */
static void MK_F(mk_fault_predict)(const MK_F_T(mk_monitor_config) * config, int rows, MK_F_T(mk_fault) * fault) {
    for (int i = 0; i < rows; i++) {
        MK_REAL *const P = fault[i].P;
        fault[i].level += fault[i].slope;
        P[0] += MK_R(2.0) * P[1] + P[2] + config->level;
        P[1] += P[2];
        P[2] += config->slope;
    }
}

/* The innovations u of this epoch, of unit variance, correct the trackers: in full while nothing speaks for an end, not at all where it is certain, or
   they would follow the end. */
static void MK_F(mk_fault_correct)(int rows, const MK_REAL *u, MK_REAL trust, MK_F_T(mk_fault) * fault) {
    for (int i = 0; i < rows; i++) {
        MK_REAL *const P = fault[i].P;
        const MK_REAL V = MK_R(1.0) + P[0], e = u[i] - fault[i].level, g = trust * P[1] / V;
        const MK_REAL keep = (MK_R(1.0) + (MK_R(1.0) - trust) * P[0]) / V; /* 1 - trust P / V */
        fault[i].level += trust * P[0] / V * e;
        fault[i].slope += g * e;
        P[2] -= g * P[1];
        P[2] = P[2] > MK_R(0.0) ? P[2] : MK_R(0.0); /* rounding */
        P[1] *= keep;
        P[0] *= keep;
    }
}

/* Are those of `rows` sums of `count` innovations of unit variance and mean zero? */
static int MK_F(mk_fault_none)(int rows, uint32_t count, const MK_REAL *threshold, const MK_F_T(mk_fault) * fault, int all) {
    MK_REAL square = MK_R(0.0);
    for (int i = 0; i < rows; i++) square += all ? fault[i].all * fault[i].all : fault[i].sum * fault[i].sum;
    return square <= threshold[rows - 1] * (MK_REAL)count;
}

/* An epoch of a sensor held faulty, with innovations u of unit variance. Returns 1 where the fault is over. */
static int MK_F(mk_fault_over)(const MK_F_T(mk_monitor_config) * config, const MK_REAL *u, MK_F_T(mk_watched) * sensor, MK_F_T(mk_fault) * fault) {
    const int rows = sensor->rows;
    MK_REAL gained = MK_R(0.0), square = MK_R(0.0);
    for (int i = 0; i < rows; i++) square += u[i] * u[i];
    if (!sensor->begun) {
        if (!(square <= MK_LARGEST)) return 0;
        MK_F(mk_fault_begin)(config->window, config->m, rows, u, fault);
        sensor->begun = 1;
        return 0;
    }
    MK_F(mk_fault_predict)(config, config->m, fault);
    for (int i = 0; i < rows; i++) {
        const MK_REAL V = MK_R(1.0) + fault[i].P[0], e = u[i] - fault[i].level;
        gained += MK_R(0.5) * (e * e / V - u[i] * u[i] + MK_F(mk_log)(V));
    }
    /* What overflows says nothing but that the fault goes on; where it is not the reading that does, the tracker has run away: it begins again. */
    if (!(square <= MK_LARGEST && gained >= -MK_LARGEST && gained <= MK_LARGEST)) {
        if (square <= MK_LARGEST) sensor->begun = 0;
        return 0;
    }
    const MK_REAL evidence = sensor->evidence + gained > MK_R(0.0) ? sensor->evidence + gained : MK_R(0.0);
    const MK_REAL trust = evidence < config->evidence ? MK_R(1.0) - evidence / config->evidence : MK_R(0.0);
    sensor->evidence = evidence;
    sensor->ratio = MK_F(mk_monitor_limit)(evidence / config->evidence);
    sensor->speaking = evidence > MK_R(0.0) ? sensor->speaking + 1 : 0;
    sensor->counted++;
    for (int i = 0; i < rows; i++) {
        fault[i].sum = evidence > MK_R(0.0) ? fault[i].sum + u[i] : MK_R(0.0);
        fault[i].all += u[i];
    }
    MK_F(mk_fault_correct)(rows, u, trust, fault);
    int over = 0;
    if (evidence > config->evidence) {
        over = MK_F(mk_fault_none)(rows, sensor->speaking, config->zero, fault, 0);
        /* Not what it was, nor nothing: another fault, or the same after a step. */
        for (int i = 0; i < rows && !over; i++) {
            const MK_REAL mean = fault[i].sum / (MK_REAL)sensor->speaking;
            MK_F(mk_fault_begin)(config->window, 1, 1, &mean, fault + i);
        }
        sensor->evidence = MK_R(0.0);
        sensor->speaking = 0;
    }
    if (sensor->counted >= config->window) {
        over |= MK_F(mk_fault_none)(rows, sensor->counted, config->back, fault, 1);
        for (int i = 0; i < config->m; i++) fault[i].all = MK_R(0.0);
        sensor->counted = 0;
    }
    return over;
}
