/* SPDX-License-Identifier: MIT */
/* Records (meshkal/record.h) of the nodes of a simulated network: the node object of firmware runs beside each simulated node, fed with its
   reading and with the frames that arrive, and has to come to the same bits. */
#ifndef MESHKAL_NODE_RECORDS_H
#define MESHKAL_NODE_RECORDS_H

#include "simulation/campaign.h"

typedef struct mk_node_records mk_node_records_t;

/* One record for each node, directory/node_NN.record, begun with configuration and state; the directory is made if it does not exist. For a
   distributed filter and a whole network of at most MK_MOST_FRAMED nodes. threads work on each step. Null and *error: a file cannot be
   written; those of this call are then removed. */
mk_node_records_t *mk_node_records_open(const mk_campaign_t *campaign, const mk_topology_t *topology, const double *tolerance, int threads,
                                        mk_error_t *error);

/* Stage 1 of step t, after that of the simulated network. schedule: tolerances of the step, or null. y, row_first, arrived: as
   `incremental` of the network had and left them. excluded: slots whose readings its monitors left out, or null. good: the
   network's step went well, its psi are compared. 1, or 0 and *error, and *bad the node. */
int mk_node_records_incremental(mk_node_records_t *records, int t, const double *schedule, const double *y, const int *row_first,
                                const uint8_t *arrived, const uint8_t *excluded, void *network, int good, int *bad, mk_error_t *error);
/* Stage 2, likewise; the records grow. */
int mk_node_records_diffuse(mk_node_records_t *records, int t, const uint8_t *arrived, void *network, int good, int *bad, mk_error_t *error);

/* Completes the files and releases everything; records of a run that ended early can be read up to there. 1, or 0 and *error. */
int mk_node_records_close(mk_node_records_t *records, mk_error_t *error);

#endif
