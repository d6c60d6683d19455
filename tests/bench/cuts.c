/* SPDX-License-Identifier: MIT */
/* What dividing a network costs, without running it: cuts SCENARIO.json PARTS ... prints JSON. Bytes and messages are those of one step in
   float64, sent; of the part that sends most. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "partition.h"
#include "process.h"

typedef struct {
    long nodes, bytes, sends, peers;
} part_t;

/* A node sends its reading and its psi to every part with a neighbour of it. */
static long count(const mk_scenario_t *s, const int *part, int parts, part_t *all) {
    unsigned char *meets = mk_allocate((size_t)parts * (size_t)parts, 1);
    int *last = mk_allocate((size_t)parts, sizeof *last); /* node that was last sent to a part, and 1 */
    long cut = 0;
    for (int k = 0; k < s->nodes; k++) {
        part_t *own = &all[part[k]];
        own->nodes++;
        for (int i = s->first[k]; i < s->first[k + 1]; i++) {
            const int other = part[s->slot[i]];
            if (other == part[k]) continue;
            cut++;
            own->peers += !meets[(size_t)part[k] * (size_t)parts + (size_t)other];
            meets[(size_t)part[k] * (size_t)parts + (size_t)other] = 1;
            if (last[other] == k + 1) continue;
            last[other] = k + 1;
            own->sends++;
            own->bytes += 8L * (s->sensor[k].rows + s->n);
        }
    }
    free(meets);
    free(last);
    return cut / 2;
}

static int divide(const mk_scenario_t *s, int parts, int more, mk_error_t *error) {
    int *part = mk_allocate((size_t)s->nodes, sizeof *part);
    part_t *all = mk_allocate((size_t)parts, sizeof *all), most = {0, 0, 0, 0};
    const double from = mk_seconds();
    const int good = mk_partition(s, parts, part, error);
    const double seconds = mk_seconds() - from;
    if (good) {
        const long cut = count(s, part, parts, all);
        long bytes = 0;
        for (int p = 0; p < parts; p++) {
            bytes += all[p].bytes;
            if (all[p].nodes > most.nodes) most.nodes = all[p].nodes;
            if (all[p].bytes > most.bytes) most.bytes = all[p].bytes;
            if (all[p].peers > most.peers) most.peers = all[p].peers;
        }
        (void)printf("%s\n  {\"parts\": %d, \"cut_links\": %ld, \"bytes_a_step\": %ld, \"most_nodes\": %ld, \"most_bytes\": %ld, \"most_peers\": %ld, "
                     "\"seconds\": %.3f}",
                     more ? "," : "", parts, cut, bytes, most.nodes, most.bytes, most.peers, seconds);
    }
    free(part);
    free(all);
    return good;
}

int main(int argc, char **argv) {
    mk_scenario_t s;
    mk_error_t error;
    if (argc < 3) {
        (void)fprintf(stderr, "usage: cuts SCENARIO.json PARTS ...\n");
        return 2;
    }
    const double from = mk_seconds();
    int good = mk_scenario_load(&s, argv[1], &error);
    if (good) {
        (void)printf("{\"nodes\": %d, \"links\": %d, \"load_seconds\": %.3f, \"cuts\": [", s.nodes, (s.first[s.nodes] - s.nodes) / 2, mk_seconds() - from);
        for (int i = 2; i < argc && good; i++) good = divide(&s, (int)strtol(argv[i], NULL, 10), i > 2, &error);
        (void)printf("]}\n");
        mk_scenario_free(&s);
    }
    if (!good) (void)fprintf(stderr, "cuts: %s\n", error.text);
    return good ? 0 : 2;
}
