/* SPDX-License-Identifier: MIT */
/* The nodes of duif_nodes.h on one target with the readings of a run of meshkal simulate --filter duif without losses, their frames really written and
   accepted: every estimate must have the simulator's bits. DUIF_BITS is 32 or 64. With "altered" on the command line one reading is changed by a
   little: that must be seen. */
#define MK_BITS DUIF_BITS
#include <meshkal/real.h>

#include <stdint.h>

#include "duif_nodes.h"

#include "duif_data.h"
#include "semihost.h"

static int step;
static uint32_t compared;

static void place(int k) {
    mk_write("step ");
    mk_write_number((uint32_t)step);
    mk_write(", node ");
    mk_write_number((uint32_t)k);
    mk_write(": ");
}

static void expect(int k, const char *call, mk_status_t status) {
    if (status == MK_OK) return;
    place(k);
    mk_write(call);
    mk_write(": ");
    mk_write(mk_status_name(status));
    mk_write("\n");
    mk_exit(1);
}

static void exchange(void) {
    uint8_t bytes[FRAME];
    for (int k = 0; k < NODES; k++) {
        const size_t length = node[k]->frame(bytes);
        for (int l = 1; l < node[k]->slots; l++) expect(neighbours[k][l], "accept", node[neighbours[k][l]]->accept(bytes, length));
    }
    for (int k = 0; k < NODES; k++) expect(k, "iterate", node[k]->iterate());
}

static void compare(int k, const MK_REAL *wanted) {
    for (int i = 0; i < N; i++, compared++) {
        MK_UINT bits[2];
        memcpy(bits, node[k]->x + i, sizeof *bits);
        memcpy(bits + 1, wanted + i, sizeof *bits);
        if (bits[0] == bits[1]) continue;
        place(k);
        mk_write("x, element ");
        mk_write_number((uint32_t)i);
        mk_write(" differs: got 0x");
        mk_write_hex(bits[0], MK_BITS / 4);
        mk_write(", wanted 0x");
        mk_write_hex(bits[1], MK_BITS / 4);
        mk_write("\n");
        mk_exit(1);
    }
}

static void one_step(int altered) {
    for (int k = 0; k < NODES; k++) {
        const MK_REAL z = told[step].z[k] * (altered && k == 0 ? MK_R(1.0001) : MK_R(1.0));
        expect(k, "predict", node[k]->predict(MK_R(1.0)));
        if (told[step].measures[k]) expect(k, "measure", node[k]->measure(&z));
        expect(k, "contribute", node[k]->contribute());
    }
    for (int l = 0; l < config[0].consensus.iterations; l++) exchange();
    for (int k = 0; k < NODES; k++) {
        expect(k, "fuse", node[k]->fuse());
        compare(k, told[step].x + k * N);
    }
}

int main(void) {
    char line[32];
    const int altered = mk_command_line(line, sizeof line) && strstr(line, " altered");
    for (int k = 0; k < NODES; k++) {
        configure(k, MK_CONSENSUS_METROPOLIS, 10, OWN_NUMBERS, 0, 0);
        expect(k, "start", node[k]->start(config + k));
    }
    for (step = 0; step < STEPS; step++) one_step(altered && step == STEPS / 2);
    mk_write_number(compared);
    mk_write(" numbers agree with the simulator\n");
    return 0;
}
