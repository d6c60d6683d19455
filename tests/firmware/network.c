/* SPDX-License-Identifier: MIT */
/* A small network on one target: the nodes of headers that meshkal design wrote, exchanging real frames, with the readings and the
   losses of a run of meshkal simulate. Every estimate and every theta must have the simulator's bits. Node 0 runs the unrolled
   kernels, the others share those of the library. NETWORK_BITS is 32 or 64. With "altered" on the command line one reading is changed by
   a little: that must be seen. */
#include <string.h>

#include <meshkal/unrolled.h>

#include "semihost.h"

#if NETWORK_BITS == 32
typedef mk_f32_t real_t;
typedef mk_rkfd_f32_t core_t;
#else
typedef mk_f64_t real_t;
typedef mk_rkfd_f64_t core_t;
#endif

#include "network_data.h"

#include "node_00.h"
#undef MK_NODE_UNROLLED
#define MK_NODE_UNROLLED MK_NODE
#include "node_01.h"
#include "node_02.h"
#include "node_03.h"
#include "node_04.h"
#include "node_05.h"

typedef struct {
    const uint16_t *slot;
    int slots;
    const core_t *core;
    const real_t *x;
    mk_status_t (*start)(void), (*incremental)(void), (*diffuse)(void);
    mk_status_t (*measure)(const real_t *y), (*accept)(const uint8_t *bytes, size_t length);
    size_t (*frame)(int stage, uint8_t *bytes);
} face_t;

#define NODE(name)                                                                                                            \
    static name##_t name##_object;                                                                                            \
    static mk_status_t start_##name(void) { return name##_start(&name##_object, &name##_config); }                            \
    static mk_status_t incremental_##name(void) { return name##_incremental(&name##_object); }                                \
    static mk_status_t diffuse_##name(void) { return name##_diffuse(&name##_object); }                                        \
    static mk_status_t measure_##name(const real_t *y) { return name##_measure(&name##_object, y); }                          \
    static mk_status_t accept_##name(const uint8_t *bytes, size_t size) { return name##_accept(&name##_object, bytes, size); } \
    static size_t frame_##name(int stage, uint8_t *bytes) { return name##_frame(&name##_object, stage, bytes); }

NODE(node00)
NODE(node01)
NODE(node02)
NODE(node03)
NODE(node04)
NODE(node05)

#define FACE(name)                                                                                                            \
    {                                                                                                                         \
        name##_slot, (int)(sizeof name##_slot / sizeof name##_slot[0]), &name##_object.filter.core, name##_object.filter.x,   \
            start_##name, incremental_##name, diffuse_##name, measure_##name, accept_##name, frame_##name                     \
    }
static const face_t node[NODES] = {FACE(node00), FACE(node01), FACE(node02), FACE(node03), FACE(node04), FACE(node05)};

static int step, altered;
static uint32_t compared, lost;

static void place(int k) {
    mk_write("step ");
    mk_write_number((uint32_t)step);
    mk_write(", node ");
    mk_write_number((uint32_t)k);
}

static void expect(int k, const char *call, mk_status_t status) {
    if (status == MK_OK) return;
    place(k);
    mk_write(": ");
    mk_write(call);
    mk_write(": ");
    mk_write(mk_status_name(status));
    mk_write("\n");
    mk_exit(1);
}

static uint64_t bits(const real_t *value) {
#if NETWORK_BITS == 32
    uint32_t word;
#else
    uint64_t word;
#endif
    memcpy(&word, value, sizeof word);
    return word;
}

static void compare(int k, const char *what, int count, const real_t *got, const real_t *wanted) {
    for (int i = 0; i < count; i++, compared++) {
        if (bits(&got[i]) == bits(&wanted[i])) continue;
        place(k);
        mk_write(": ");
        mk_write(what);
        mk_write(", element ");
        mk_write_number((uint32_t)i);
        mk_write(" differs: got 0x");
        mk_write_hex(bits(&got[i]), NETWORK_BITS / 4);
        mk_write(", wanted 0x");
        mk_write_hex(bits(&wanted[i]), NETWORK_BITS / 4);
        mk_write("\n");
        mk_exit(1);
    }
}

/* Every frame is sent; what arrived is taken. `arrived`: slots of all nodes. */
static void exchange(int stage, const uint8_t *arrived) {
    static uint8_t bytes[NODES][node00_frame_max];
    size_t size[NODES];
    for (int k = 0; k < NODES; k++) size[k] = node[k].frame(stage, bytes[k]);
    for (int k = 0; k < NODES; arrived += node[k++].slots) {
        for (int l = 1; l < node[k].slots; l++) {
            const int from = node[k].slot[l];
            if (arrived[l]) expect(k, "accept", node[k].accept(bytes[from], size[from]));
            else lost++;
        }
    }
}

static void one_step(void) {
    const real_t *y = measurement[step];
    const uint8_t *arrived = have_measurement[step];
    for (int k = 0; k < NODES; k++) {
        compare(k, "estimate", STATES, node[k].x, estimate[step] + k * STATES);
        if (*arrived) {
            real_t reading[ROWS];
            memcpy(reading, y, sizeof *y * node_rows[k]);
            if (altered && step == STEPS / 2) reading[0] *= (real_t)1.0001f;
            expect(k, "measure", node[k].measure(reading));
        }
        y += node_rows[k];
        arrived += node[k].slots;
    }
    exchange(MK_STAGE_MEASUREMENT, have_measurement[step]);
    for (int k = 0; k < NODES; k++) expect(k, "incremental", node[k].incremental());
    exchange(MK_STAGE_ESTIMATE, have_estimate[step]);
    for (int k = 0; k < NODES; k++) {
        expect(k, "diffuse", node[k].diffuse());
        compare(k, "theta", 1, &node[k].core->theta, &theta[step][k]);
    }
}

int main(void) {
    char line[32];
    altered = mk_command_line(line, sizeof line) && strstr(line, " altered");
    for (int k = 0; k < NODES; k++) expect(k, "start", node[k].start());
    for (step = 0; step < STEPS; step++) one_step();
    if (lost < STEPS || node[0].core->theta == (real_t)0) {
        mk_write("without losses, and with theta 0, half of the code is not compared\n");
        return 1;
    }
    mk_write_number(compared);
    mk_write(" numbers agree, frames lost: ");
    mk_write_number(lost);
    mk_write("\n");
    return 0;
}
