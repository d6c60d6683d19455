/* SPDX-License-Identifier: MIT */
/*
 * The library's consensus on any graph, also one where no node measures, which in a filter would have nothing to agree on.
 *
 * Standard input: protocol (paper, perron, metropolis, ratio), iterations L, nodes N; then for each node: measures (0 or 1), its value, how many
 * nodes it hears, and which. Standard output: L + 1 lines, the N estimates of the mean after 0 .. L iterations.
 * Exit status 2: wrong input.
 */
#include <meshkal/consensus.h>
#include <stdio.h>
#include <string.h>

enum { MOST_NODES = 16, MOST_ITERATIONS = 1000 };

/* Memory for the most slots; the functions for dimensions known at run time take as many as a node has. */
MK_CONSENSUS(consensus, f64, 1, MOST_NODES);

typedef struct {
    consensus_t object;
    consensus_config_t config;
    mk_consensus_view_f64_t view;
    uint16_t degree[MOST_NODES];
    int hears[MOST_NODES], measures;
    double value;
} network_node_t;

static network_node_t node[MOST_NODES];
static double work[MK_CONSENSUS_WORK(1)];

static int complain(const char *text) {
    (void)fprintf(stderr, "consensus-run: %s\n", text);
    return 2;
}

static int read_nodes(int nodes) {
    for (int k = 0; k < nodes; k++) {
        network_node_t *const self = &node[k];
        int count;
        if (scanf("%d %lf %d", &self->measures, &self->value, &count) != 3 || count < 0 || count >= MOST_NODES) return 0;
        self->hears[0] = k;
        self->config.slots = (uint16_t)(1 + count);
        for (int i = 1; i <= count; i++)
            if (scanf("%d", &self->hears[i]) != 1 || self->hears[i] < 0 || self->hears[i] >= nodes || self->hears[i] == k) return 0;
    }
    return 1;
}

static mk_status_t start(int nodes, int iterations, uint8_t protocol) {
    mk_status_t status = MK_OK;
    for (int k = 0; k < nodes && status == MK_OK; k++) {
        network_node_t *const self = &node[k];
        self->config.values = 1;
        self->config.iterations = (uint16_t)iterations;
        self->config.network = (uint16_t)nodes;
        self->config.protocol = protocol;
        for (int i = 0; i < self->config.slots; i++) self->degree[i] = (uint16_t)(node[self->hears[i]].config.slots - 1);
        self->config.degree = self->degree;
        self->view = consensus_view(&self->object, work);
        status = mk_consensus_start_f64(1, self->config.slots, &self->view, &self->config);
        if (status == MK_OK) status = mk_consensus_begin_f64(1, &self->view, &self->value, self->measures);
    }
    return status;
}

static mk_status_t iterate(int nodes, uint32_t iteration) {
    mk_status_t status = MK_OK;
    for (int k = 0; k < nodes; k++)
        for (int i = 1; i < node[k].config.slots && status == MK_OK; i++)
            status = mk_consensus_put_f64(1, &node[k].view, i, iteration, consensus_message(&node[node[k].hears[i]].object));
    for (int k = 0; k < nodes && status == MK_OK; k++) status = mk_consensus_iterate_f64(1, &node[k].view);
    return status;
}

/* "-" where a node has no estimate: of a ratio without mass. */
static void print(int nodes) {
    for (int k = 0; k < nodes; k++) {
        double mean;
        if (mk_consensus_average_f64(&node[k].view, &mean) == MK_OK) (void)printf("%s%.17g", k ? " " : "", mean);
        else (void)printf("%s-", k ? " " : "");
    }
    (void)puts("");
}

int main(void) {
    static const struct {
        const char *name;
        uint8_t protocol;
    } protocols[] = {{"paper", MK_CONSENSUS_PAPER}, {"perron", MK_CONSENSUS_PERRON}, {"metropolis", MK_CONSENSUS_METROPOLIS}, {"ratio", MK_CONSENSUS_RATIO}};
    char name[20];
    int iterations, nodes;
    size_t which = 0;
    mk_status_t status;
    if (scanf("%19s %d %d", name, &iterations, &nodes) != 3) return complain("no protocol, iterations, nodes");
    while (which < sizeof protocols / sizeof *protocols && strcmp(name, protocols[which].name) != 0) which++;
    if (which == sizeof protocols / sizeof *protocols) return complain("unknown protocol");
    if (iterations < 1 || iterations > MOST_ITERATIONS || nodes < 1 || nodes > MOST_NODES) return complain("too many or too few iterations or nodes");
    if (!read_nodes(nodes)) return complain("a node is wrong");
    status = start(nodes, iterations, protocols[which].protocol);
    if (status == MK_OK) print(nodes);
    for (int l = 0; l < iterations && status == MK_OK; l++) {
        status = iterate(nodes, (uint32_t)l);
        if (status == MK_OK) print(nodes);
    }
    return status == MK_OK ? 0 : complain(mk_status_name(status));
}
