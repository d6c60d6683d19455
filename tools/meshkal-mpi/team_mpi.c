/* SPDX-License-Identifier: MIT */
#include "team_mpi.h"

#include <mpi.h>
#include <stdlib.h>
#include <string.h>

#include "partition.h"
#include "simulation/division.h"

/* MPI counts in int: longer messages go in pieces. */
#define LONGEST ((size_t)1 << 30)

typedef struct {
    mk_division_t division;
    MPI_Comm graph; /* of the peers, while a network is divided */
    MPI_Request request;
    /* For every stage: bytes to and from each peer, and their places. */
    int *send_count[MK_EXCHANGES], *send_place[MK_EXCHANGES], *receive_count[MK_EXCHANGES], *receive_place[MK_EXCHANGES];
    /* On rank 0: nodes of all parts, part by part from node_first[rank]. */
    int *node, *node_first;
} job_t;

static int agree(mk_team_t *team, int good, mk_error_t *error) {
    int first = good ? team->ranks : team->rank;
    (void)MPI_Allreduce(MPI_IN_PLACE, &first, 1, MPI_INT, MPI_MIN, MPI_COMM_WORLD);
    if (first == team->ranks) return 1;
    (void)MPI_Bcast(error, (int)sizeof *error, MPI_BYTE, first, MPI_COMM_WORLD);
    return 0;
}

static void spread(mk_team_t *team, void *bytes, size_t length) {
    (void)team;
    for (size_t done = 0; done < length; done += LONGEST)
        (void)MPI_Bcast((char *)bytes + done, (int)(length - done < LONGEST ? length - done : LONGEST), MPI_BYTE, 0, MPI_COMM_WORLD);
}

static int same(mk_team_t *team, const char *text, mk_error_t *error) {
    size_t length = strlen(text);
    spread(team, &length, sizeof length);
    char *first = mk_allocate(length + 1, 1);
    if (team->rank == 0) memcpy(first, text, length);
    spread(team, first, length);
    size_t name = 0, value = 0;
    for (size_t i = 0; text[i] && text[i] == first[i]; i++) {
        if (text[i] != ' ') continue;
        name = value;
        value = i + 1;
    }
    const int good = strcmp(first, text) == 0 || mk_fail(error, "rank %d: %.*s is %.*s, but %.*s on rank 0: all processes need the same scenario and options",
                                                         team->rank, (int)(value - name - 1), text + name, (int)strcspn(text + value, " "), text + value,
                                                         (int)strcspn(first + value, " "), first + value);
    free(first);
    return agree(team, good, error);
}

static void collect(mk_team_t *team, const void *bytes, size_t length, void (*take)(void *, const void *, size_t), void *context) {
    if (team->rank > 0) {
        (void)MPI_Send(&length, (int)sizeof length, MPI_BYTE, 0, 0, MPI_COMM_WORLD);
        for (size_t done = 0; done < length; done += LONGEST)
            (void)MPI_Send((const char *)bytes + done, (int)(length - done < LONGEST ? length - done : LONGEST), MPI_BYTE, 0, 1, MPI_COMM_WORLD);
        return;
    }
    if (length > 0) take(context, bytes, length);
    for (int rank = 1; rank < team->ranks; rank++) {
        size_t theirs = 0;
        (void)MPI_Recv(&theirs, (int)sizeof theirs, MPI_BYTE, rank, 0, MPI_COMM_WORLD, MPI_STATUS_IGNORE);
        char *room = mk_allocate(theirs, 1);
        for (size_t done = 0; done < theirs; done += LONGEST)
            (void)MPI_Recv(room + done, (int)(theirs - done < LONGEST ? theirs - done : LONGEST), MPI_BYTE, rank, 1, MPI_COMM_WORLD, MPI_STATUS_IGNORE);
        if (theirs > 0) take(context, room, theirs);
        free(room);
    }
}

static void sum(mk_team_t *team, mk_exact_t *sums, size_t count) {
    (void)team;
    (void)MPI_Allreduce(MPI_IN_PLACE, sums, (int)(count * MK_EXACT_DIGITS), MPI_INT64_T, MPI_SUM, MPI_COMM_WORLD);
}

/* --- a network in parts ---------------------------------------------------------------------------------------------------- */

static size_t node_bytes(const mk_scenario_t *s, int k, mk_exchange_t stage, size_t real_size) {
    return stage == MK_EXCHANGE_READINGS ? (size_t)s->sensor[k].rows * sizeof(double) : (size_t)s->n * real_size;
}

/* Bytes of every peer's values, one after another. */
static double count_bytes(const mk_division_t *d, const mk_scenario_t *s, mk_exchange_t stage, size_t real_size, const int *first, int is_halo, int **count,
                          int **place) {
    double total = 0.0;
    *count = mk_allocate((size_t)d->peers + 1, sizeof **count);
    *place = mk_allocate((size_t)d->peers + 1, sizeof **place);
    for (int p = 0; p < d->peers; p++) {
        (*place)[p] = p ? (*place)[p - 1] + (*count)[p - 1] : 0;
        for (int i = first[p]; i < first[p + 1]; i++)
            (*count)[p] += (int)node_bytes(s, is_halo ? d->topology.halo_node[i] : d->topology.id[d->topology.send_estimator[i]], stage, real_size);
        total += (*count)[p];
    }
    return total;
}

/* Who holds which node, on rank 0. */
static void list_parts(mk_team_t *team, job_t *job, int nodes) {
    const mk_topology_t *t = &job->division.topology;
    int *count = mk_allocate((size_t)team->ranks, sizeof *count);
    job->node_first = mk_allocate((size_t)team->ranks + 1, sizeof *job->node_first);
    job->node = mk_allocate((size_t)nodes, sizeof *job->node);
    (void)MPI_Gather(&t->estimators, 1, MPI_INT, count, 1, MPI_INT, 0, MPI_COMM_WORLD);
    for (int rank = 0; rank < team->ranks && team->rank == 0; rank++) job->node_first[rank + 1] = job->node_first[rank] + count[rank];
    (void)MPI_Gatherv(t->id, t->estimators, MPI_INT, job->node, count, job->node_first, MPI_INT, 0, MPI_COMM_WORLD);
    free(count);
}

static int divide(mk_team_t *team, const mk_scenario_t *s, size_t real_size, mk_topology_t *topology, mk_error_t *error) {
    job_t *job = team->context;
    mk_division_t *d = &job->division;
    int *part = mk_allocate((size_t)s->nodes, sizeof *part);
    const int good = agree(team, team->rank > 0 || mk_partition(s, team->ranks, part, error), error);
    if (good) {
        spread(team, part, (size_t)s->nodes * sizeof *part);
        mk_division_make(d, s, part, team->ranks, team->rank);
        double totals[2] = {0.0, (double)d->cut_edges / 2.0};
        for (int stage = 0; stage < MK_EXCHANGES; stage++) {
            totals[0] += count_bytes(d, s, (mk_exchange_t)stage, real_size, d->send_first, 0, &job->send_count[stage], &job->send_place[stage]);
            (void)count_bytes(d, s, (mk_exchange_t)stage, real_size, d->halo_first, 1, &job->receive_count[stage], &job->receive_place[stage]);
        }
        (void)MPI_Dist_graph_create_adjacent(MPI_COMM_WORLD, d->peers, d->peer, job->receive_count[MK_EXCHANGE_ESTIMATES], d->peers, d->peer,
                                             job->send_count[MK_EXCHANGE_ESTIMATES], MPI_INFO_NULL, 0, &job->graph);
        (void)MPI_Allreduce(MPI_IN_PLACE, totals, 2, MPI_DOUBLE, MPI_SUM, MPI_COMM_WORLD);
        team->bytes_a_step = totals[0];
        team->cut_edges = (long)totals[1];
        list_parts(team, job, s->nodes);
        *topology = d->topology;
    }
    free(part);
    return good;
}

static void release(mk_team_t *team, mk_topology_t *topology) {
    job_t *job = team->context;
    (void)topology;
    (void)MPI_Comm_free(&job->graph);
    for (int stage = 0; stage < MK_EXCHANGES; stage++) {
        free(job->send_count[stage]);
        free(job->send_place[stage]);
        free(job->receive_count[stage]);
        free(job->receive_place[stage]);
    }
    free(job->node);
    free(job->node_first);
    mk_division_free(&job->division);
}

static void begin(mk_team_t *team, mk_exchange_t stage, const void *send, void *receive) {
    job_t *job = team->context;
    (void)MPI_Ineighbor_alltoallv(send, job->send_count[stage], job->send_place[stage], MPI_BYTE, receive, job->receive_count[stage],
                                  job->receive_place[stage], MPI_BYTE, job->graph, &job->request);
}

static void finish(mk_team_t *team) {
    job_t *job = team->context;
    (void)MPI_Wait(&job->request, MPI_STATUS_IGNORE);
}

static void gather(mk_team_t *team, const mk_topology_t *topology, const void *local, const int *first, size_t width, void *all) {
    const job_t *job = team->context;
    int *count = mk_allocate(2 * (size_t)team->ranks, sizeof *count), *place = count + team->ranks, own = 0;
    char *room = NULL;
    for (int e = 0; e < topology->estimators; e++) own += first ? first[topology->id[e] + 1] - first[topology->id[e]] : 1;
    if (team->rank == 0) {
        size_t total = 0;
        for (int rank = 0; rank < team->ranks; rank++) {
            place[rank] = (int)total;
            for (int i = job->node_first[rank]; i < job->node_first[rank + 1]; i++) count[rank] += first ? first[job->node[i] + 1] - first[job->node[i]] : 1;
            total += (size_t)count[rank];
        }
        room = mk_allocate(total, width);
    }
    /* Elements, not bytes: counts are int. */
    MPI_Datatype element;
    (void)MPI_Type_contiguous((int)width, MPI_BYTE, &element);
    (void)MPI_Type_commit(&element);
    (void)MPI_Gatherv(local, own, element, room, count, place, element, 0, MPI_COMM_WORLD);
    (void)MPI_Type_free(&element);
    if (team->rank == 0) {
        const char *next = room;
        for (int i = 0; i < job->node_first[team->ranks]; i++) {
            const int k = job->node[i], from = first ? first[k] : k, to = first ? first[k + 1] : k + 1;
            memcpy((char *)all + (size_t)from * width, next, (size_t)(to - from) * width);
            next += (size_t)(to - from) * width;
        }
    }
    free(room);
    free(count);
}

void mk_team_mpi_open(mk_team_t *team) {
    const mk_team_t mpi = {0, 1, agree, same, collect, spread, divide, release, sum, begin, finish, gather, 0.0, 0, mk_allocate(1, sizeof(job_t))};
    *team = mpi;
    (void)MPI_Comm_rank(MPI_COMM_WORLD, &team->rank);
    (void)MPI_Comm_size(MPI_COMM_WORLD, &team->ranks);
}

void mk_team_mpi_close(mk_team_t *team) { free(team->context); }
