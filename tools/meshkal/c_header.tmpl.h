/* SPDX-License-Identifier: MIT */

/* Hexadecimal floats: exact, and any C99 or C++17 compiler reads them back to the same bits. */
static void MK_F(put_array)(FILE *out, const char *name, const char *member, const char *comment, const MK_REAL *values, int count, int columns) {
    (void)fprintf(out, "\n/* %s */\nstatic const mk_" MK_REAL_SUFFIX "_t %s_%s[%d] = {", comment, name, member, count);
    for (int i = 0; i < count; i++) (void)fprintf(out, "%s%a" MK_REAL_LITERAL ",", i % columns ? " " : "\n    ", (double)values[i]);
    (void)fputs("\n};\n", out);
}

/* The steady part, if the node has one; 0 and *why if not. */
static int MK_F(put_steady)(FILE *out, const char *name, const MK_F_T(mk_rkfd_config) * config, const mk_scenario_t *s, const mk_topology_t *topology,
                            int k, double tolerance, double close, const char **why) {
    const int n = config->n, m = config->m, slots = config->slots;
    MK_F_T(mk_rkfd_steady) steady;
    MK_REAL *numbers = mk_allocate(MK_STEADY_NUMBERS((size_t)n, (size_t)m, (size_t)slots), sizeof *numbers);
    const int has = MK_F(mk_steady_make)(&steady, numbers, config, s, topology, k, tolerance, close, why);
    if (has) {
        MK_F(put_array)(out, name, "Phi", "Frozen gain: Phi = A - sum G_l C_l, by columns", steady.Phi, n * n, n);
        MK_F(put_array)(out, name, "G", "G_l by columns, for each slot", steady.G, slots * m * n, n);
        MK_F(put_array)(out, name, "W", "W of the limit, packed", steady.W, MK_PACKED(n), n);
        (void)fprintf(out, "\nstatic const mk_rkfd_steady_" MK_REAL_SUFFIX "_t %s_steady = {\n    %s_Phi, %s_G, %s_W, %a" MK_REAL_LITERAL
                           " /* theta */, %a" MK_REAL_LITERAL " /* trace P */,\n    %a" MK_REAL_LITERAL " /* close: %.2g */, %d /* period */\n};\n",
                      name, name, name, name, (double)steady.theta, (double)steady.trace_P, (double)steady.close, (double)steady.close, steady.period);
    } else {
        (void)fprintf(out, "\n/* No frozen gain: %s. */\n", *why);
    }
    free(numbers);
    return has;
}

/* 1, or 0 and *why: a frozen gain was asked for and the node has none. */
static int MK_F(put_node)(FILE *out, const char *name, const mk_scenario_t *s, const mk_topology_t *topology, int k, double tolerance, double close,
                          const char **why) {
    MK_F_T(mk_node_config) node;
    MK_F(mk_node_config_make)(&node, s, topology, k, tolerance);
    const MK_F_T(mk_rkfd_config) config = node.filter;
    const int n = config.n, m = config.m, slots = config.slots;
    (void)fprintf(out,
                  "#include <meshkal/unrolled.h>\n\n/* %d states, at most %d rows, %d slots. To save flash: MK_NODE of <meshkal/node.h>. */\n"
                  "MK_NODE_UNROLLED(%s, " MK_REAL_SUFFIX ", %d, %d, %d);\n\n/* Node in each slot: this one, then its neighbours. */\n"
                  "static const uint16_t %s_slot[%d] = {",
                  n, m, slots, name, n, m, slots, name, slots);
    for (int l = 0; l < slots; l++) (void)fprintf(out, "%s%d", l ? ", " : "", node.nodes[l]);
    (void)fprintf(out, "};\nstatic const uint8_t %s_rows[%d] = {", name, slots);
    for (int l = 0; l < slots; l++) (void)fprintf(out, "%s%d", l ? ", " : "", config.rows[l]);
    (void)fputs("};\n", out);
    MK_F(put_array)(out, name, "A", "A, by rows", config.A, n * n, n);
    MK_F(put_array)(out, name, "Q", "Q, packed", config.Q, MK_PACKED(n), n);
    MK_F(put_array)(out, name, "input", "r", config.input, n, n);
    MK_F(put_array)(out, name, "x0", "x(0)", config.x0, n, n);
    MK_F(put_array)(out, name, "P0", "P(0), packed", config.P0, MK_PACKED(n), n);
    MK_F(put_array)(out, name, "weight", "w_lk for each slot", config.weight, slots, 8);
    MK_F(put_array)(out, name, "C", "C_l by rows, for each slot", config.C, slots * m * n, n);
    MK_F(put_array)(out, name, "F", "F_l = C_l' R_l^-1 by columns, for each slot", config.F, slots * m * n, n);
    MK_F(put_array)(out, name, "S", "S_l = F_l C_l, packed, for each slot", config.S, slots * MK_PACKED(n), n);
    MK_F(put_array)(out, name, "R_inverse", "R_l^-1, packed, for each slot", config.R_inverse, slots * MK_PACKED(m), MK_PACKED(m));
    char steady_name[80];
    (void)snprintf(steady_name, sizeof steady_name, "%s_steady", name);
    const int has = close > 0.0 && MK_F(put_steady)(out, name, &config, s, topology, k, tolerance, close, why);
    (void)fprintf(out,
                  "\nstatic const %s_config_t %s_config = {\n    {%d, %d, %d, %s_A, %s_Q, %s_input, %s_x0, %s_P0, %s_weight, %s_rows, %s_C, %s_F, %s_S,\n"
                  "     %s_R_inverse, %a" MK_REAL_LITERAL " /* tolerance %.9g */, %s%s},\n"
                  "    %s_slot, 0x%08lx, %d /* steps it makes up for */, MK_NUMBERS_F%d, 0, 0, 0\n};\n",
                  name, name, n, m, slots, name, name, name, name, name, name, name, name, name, name, name, (double)config.tolerance, tolerance,
                  has ? "&" : "0", has ? steady_name : "", name, (unsigned long)node.model, node.catch_up, MK_BITS);
    MK_F(mk_node_config_free)(&node);
    return has || !(close > 0.0);
}
