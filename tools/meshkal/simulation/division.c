/* SPDX-License-Identifier: MIT */
#include "simulation/division.h"

#include <stdlib.h>
#include <string.h>

/* Nodes of a cluster: what a step of them all touches fits a core's own cache. */
enum { CLUSTER = 512 };

static int *integers(long count) { return mk_allocate((size_t)count + 1, sizeof(int)); }

static int is_inner(const mk_scenario_t *s, const int *part, int k) {
    for (int i = s->first[k]; i < s->first[k + 1]; i++)
        if (part[s->slot[i]] != part[k]) return 0;
    return 1;
}

/* A node that waits for its place in the order, perhaps on the rim of a cluster. */
enum { PLACED, WAITING, ON_RIM };

/* Takes the nodes that wait into the order, cluster by cluster: breadth first from a node on the rim of an earlier one. Nodes that hear each
   other come to stand near each other. rim: room for all nodes. */
static void list_clusters(const mk_scenario_t *s, uint8_t *state, int *rim, int *id, int *count) {
    int rims = 0, next = 0;
    for (int first = 0; first < s->nodes; first++) {
        if (state[first] != WAITING) continue;
        state[first] = ON_RIM;
        rim[rims++] = first;
        while (next < rims) {
            const int seed = rim[next++], begin = *count;
            if (state[seed] == PLACED) continue;
            state[seed] = PLACED;
            id[(*count)++] = seed;
            for (int i = begin; i < *count; i++)
                for (int j = s->first[id[i]]; j < s->first[id[i] + 1]; j++) {
                    const int k = s->slot[j];
                    if (state[k] == PLACED) continue;
                    if (*count - begin < CLUSTER) {
                        state[k] = PLACED;
                        id[(*count)++] = k;
                    } else if (state[k] == WAITING) {
                        state[k] = ON_RIM;
                        rim[rims++] = k;
                    }
                }
        }
    }
}

/* The part's nodes, those with all neighbours in it first; place: of each in that order. */
static int *list_nodes(const mk_scenario_t *s, const int *part, int own, int *place, int *count, int *inner) {
    int *id = integers(s->nodes), *rim = integers(s->nodes);
    uint8_t *state = mk_allocate((size_t)s->nodes, 1);
    *count = 0;
    for (int round = 0; round < 2; round++) {
        for (int k = 0; k < s->nodes; k++) state[k] = part[k] == own && is_inner(s, part, k) == !round ? WAITING : PLACED;
        list_clusters(s, state, rim, id, count);
        if (round == 0) *inner = *count;
    }
    for (int i = 0; i < *count; i++) place[id[i]] = i;
    free(rim);
    free(state);
    return id;
}

/* For every peer in turn: this part's nodes with a neighbour there (send), and that part's nodes with a neighbour here (halo). Both sides of
   a pair list the same nodes in the same order. */
static void list_exchange(mk_division_t *d, const mk_scenario_t *s, const int *part, int own, const int *place, int *halo_place) {
    int *send = integers(0), *halo = integers(0), sends = 0, halos = 0, send_room = 1, halo_room = 1;
    for (int p = 0; p < d->peers; p++) {
        d->send_first[p] = sends;
        d->halo_first[p] = halos;
        for (int k = 0; k < s->nodes; k++) {
            const int here = part[k] == own, wanted = here ? d->peer[p] : own;
            if (!here && part[k] != d->peer[p]) continue;
            int meets = 0;
            for (int i = s->first[k]; i < s->first[k + 1] && !meets; i++) meets = part[s->slot[i]] == wanted;
            if (!meets) continue;
            int **list = here ? &send : &halo, *used = here ? &sends : &halos, *room = here ? &send_room : &halo_room;
            if (*used == *room) {
                int *larger = realloc(*list, 2 * (size_t)*room * sizeof *larger);
                if (!larger) exit(1);
                *list = larger;
                *room *= 2;
            }
            if (!here) halo_place[k] = halos;
            (*list)[(*used)++] = here ? place[k] : k;
        }
    }
    d->send_first[d->peers] = sends;
    d->halo_first[d->peers] = halos;
    d->topology.sends = sends;
    d->topology.halo = halos;
    d->topology.send_estimator = send;
    d->topology.halo_node = halo;
}

/* The slots of the part's nodes, with where the estimate of each comes from. */
static void copy_slots(mk_division_t *d, const mk_scenario_t *s, const int *part, int own, const int *place, const int *halo_place) {
    mk_topology_t *t = &d->topology;
    int *first = integers(t->estimators);
    for (int e = 0; e < t->estimators; e++) first[e + 1] = first[e] + s->first[t->id[e] + 1] - s->first[t->id[e]];
    int *slot = integers(first[t->estimators]), *origin = integers(first[t->estimators]);
    double *weight = mk_allocate((size_t)first[t->estimators], sizeof *weight);
    for (int e = 0; e < t->estimators; e++)
        for (int i = first[e], from = s->first[t->id[e]]; i < first[e + 1]; i++, from++) {
            const int k = s->slot[from];
            slot[i] = k;
            weight[i] = s->weight[from];
            origin[i] = part[k] == own ? place[k] : -1 - halo_place[k];
            d->cut_edges += part[k] != own;
        }
    t->first = first;
    t->slot = slot;
    t->weight = weight;
    t->origin = origin;
}

void mk_division_make(mk_division_t *d, const mk_scenario_t *s, const int *part, int parts, int own) {
    int *place = integers(s->nodes), *halo_place = integers(s->nodes), *is_peer = integers(parts);
    memset(d, 0, sizeof *d);
    d->topology.id = list_nodes(s, part, own, place, &d->topology.estimators, &d->topology.interior);
    for (int e = d->topology.interior; e < d->topology.estimators; e++) {
        const int k = d->topology.id[e];
        for (int i = s->first[k]; i < s->first[k + 1]; i++) is_peer[part[s->slot[i]]] = part[s->slot[i]] != own;
    }
    d->peer = integers(parts);
    d->send_first = integers(parts);
    d->halo_first = integers(parts);
    for (int p = 0; p < parts; p++)
        if (is_peer[p]) d->peer[d->peers++] = p;
    list_exchange(d, s, part, own, place, halo_place);
    copy_slots(d, s, part, own, place, halo_place);
    free(place);
    free(halo_place);
    free(is_peer);
}

/* The topology is read-only for everybody else. */
static void release(const void *block) {
    void *own;
    memcpy(&own, &block, sizeof own);
    free(own);
}

void mk_division_free(mk_division_t *d) {
    release(d->topology.id);
    release(d->topology.first);
    release(d->topology.slot);
    release(d->topology.weight);
    release(d->topology.origin);
    release(d->topology.halo_node);
    release(d->topology.send_estimator);
    free(d->peer);
    free(d->send_first);
    free(d->halo_first);
    memset(d, 0, sizeof *d);
}
