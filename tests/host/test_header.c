/* SPDX-License-Identifier: MIT */
/* The promise of `meshkal design --c-header`: the headers of a network, run as firmware runs them, with frames that are lost, repeated
   and out of order, give the simulator's numbers bit for bit. Measurements and arrivals come from a log of `meshkal simulate`.

   Compile with -DHEADER_BITS=32 or 64, -I of six headers node_00.h .. node_05.h and -DHEADER_LOG="path" of a log of their network.
   -DHEADER_SHARED replaces the unrolled kernels by those of libmeshkal.a. -DHEADER_FROZEN: headers and log were made with --frozen. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include <cbor.h>
#include <meshkal/unrolled.h>

#ifdef HEADER_SHARED
#undef MK_NODE_UNROLLED
#define MK_NODE_UNROLLED MK_NODE
#endif

#include "node_00.h"
#include "node_01.h"
#include "node_02.h"
#include "node_03.h"
#include "node_04.h"
#include "node_05.h"

#if HEADER_BITS == 32
typedef mk_f32_t real_t;
typedef mk_rkfd_f32_t core_t;
enum { REAL_TAG = 85 };
#else
typedef mk_f64_t real_t;
typedef mk_rkfd_f64_t core_t;
enum { REAL_TAG = 86 };
#endif
enum { UINT8_TAG = 64, UINT32_TAG = 70, FLOAT64_TAG = 86 };
#ifdef HEADER_FROZEN
enum { NODES = 6, STEPS = 900, LARGEST = 64 };
#else
enum { NODES = 6, STEPS = 200, LARGEST = 64 };
#endif

/* --- one face for six types --------------------------------------------------------------------------------------------- */

typedef struct {
    int slots, states, rows_most;
    const uint16_t *slot;
    const uint8_t *rows;
    const core_t *core;
    const real_t *x;
    mk_status_t (*start)(void), (*incremental)(void), (*diffuse)(void);
    mk_status_t (*measure)(const real_t *y), (*accept)(const uint8_t *bytes, size_t length);
    size_t (*frame)(int stage, uint8_t *bytes);
    mk_status_t (*covariance)(real_t *V);
    mk_status_t (*innovations)(real_t *r, real_t *S, uint8_t *rows);
} face_t;

/* Before each incremental step of a network with frozen gains the node is switched off and comes back from what it has saved. */
#ifdef HEADER_FROZEN
#define REVIVE(name)                                                                                                          \
    uint8_t blob[name##_blob_max];                                                                                            \
    const size_t saved = name##_save(&name##_object, blob);                                                                   \
    memset(&name##_object, 0x55, sizeof name##_object);                                                                       \
    const mk_status_t status = name##_restore(&name##_object, &name##_config, blob, saved);                                   \
    if (status != MK_OK) return status;
#else
#define REVIVE(name)
#endif

#define NODE(name)                                                                                                            \
    static name##_t name##_object;                                                                                            \
    static mk_status_t start_##name(void) { return name##_start(&name##_object, &name##_config); }                            \
    static mk_status_t incremental_##name(void) {                                                                             \
        REVIVE(name)                                                                                                          \
        return name##_incremental(&name##_object);                                                                            \
    }                                                                                                                         \
    static mk_status_t diffuse_##name(void) { return name##_diffuse(&name##_object); }                                        \
    static mk_status_t measure_##name(const real_t *y) { return name##_measure(&name##_object, y); }                          \
    static mk_status_t accept_##name(const uint8_t *bytes, size_t size) { return name##_accept(&name##_object, bytes, size); } \
    static size_t frame_##name(int stage, uint8_t *bytes) { return name##_frame(&name##_object, stage, bytes); }              \
    static mk_status_t covariance_##name(real_t *V) { return name##_filter_covariance(&name##_object.filter, V); }              \
    static mk_status_t innovations_##name(real_t *r, real_t *S, uint8_t *rows) { return name##_innovations(&name##_object, r, S, rows); }

NODE(node00)
NODE(node01)
NODE(node02)
NODE(node03)
NODE(node04)
NODE(node05)

#define FACE(name)                                                                                                            \
    {                                                                                                                         \
        (int)(sizeof name##_slot / sizeof name##_slot[0]), (int)(sizeof name##_object.filter.x / sizeof(real_t)),             \
            (int)(sizeof name##_object.filter.y / sizeof(real_t) / (sizeof name##_slot / sizeof name##_slot[0])), name##_slot, \
            name##_rows, &name##_object.filter.core, name##_object.filter.x, start_##name, incremental_##name,                \
            diffuse_##name, measure_##name, accept_##name, frame_##name, covariance_##name, innovations_##name                \
    }
static const face_t node[NODES] = {FACE(node00), FACE(node01), FACE(node02), FACE(node03), FACE(node04), FACE(node05)};

/* --- the log ------------------------------------------------------------------------------------------------------------ */

static unsigned char *text;
static size_t length, at;

static void read_log(const char *path) {
    FILE *file = fopen(path, "rb");
    if (!file || fseek(file, 0, SEEK_END) != 0) exit(2);
    length = (size_t)ftell(file);
    rewind(file);
    text = malloc(length);
    if (!text || fread(text, 1, length, file) != length) exit(2);
    (void)fclose(file);
}

static cbor_item_t *next_item(void) {
    struct cbor_load_result result;
    cbor_item_t *item = cbor_load(text + at, length - at, &result);
    assert_non_null(item);
    assert_true(cbor_isa_map(item));
    at += result.read;
    return item;
}

/* A member, still owned by the item. */
static cbor_item_t *member(cbor_item_t *item, const char *key) {
    struct cbor_pair *pair = cbor_map_handle(item);
    for (size_t i = 0; i < cbor_map_size(item); i++)
        if (cbor_string_length(pair[i].key) == strlen(key) && memcmp(cbor_string_handle(pair[i].key), key, strlen(key)) == 0)
            return pair[i].value;
    fail_msg("the log has no %s", key);
    return NULL;
}

/* Copies a typed array of exactly `size` bytes. */
static void numbers(cbor_item_t *item, const char *key, uint64_t tag, void *to, size_t size) {
    cbor_item_t *array = member(item, key);
    assert_true(cbor_isa_tag(array));
    assert_int_equal(cbor_tag_value(array), tag);
    cbor_item_t *bytes = cbor_tag_item(array);
    assert_int_equal(cbor_bytestring_length(bytes), size);
    memcpy(to, cbor_bytestring_handle(bytes), size);
    cbor_decref(&bytes);
}

static int slots_before(int k) { return k ? slots_before(k - 1) + node[k - 1].slots : 0; }

/* --- tests -------------------------------------------------------------------------------------------------------------- */

/* Headers and log speak of the same network, so that equal numbers later mean something. */
static void same_network(void **unused) {
    (void)unused;
    at = 0;
    cbor_item_t *header = next_item(), *slots = member(header, "slots"), *rows = member(header, "rows");
    assert_int_equal(cbor_array_size(slots), NODES);
    for (size_t k = 0; k < NODES; k++) {
        cbor_item_t *list = cbor_array_handle(slots)[k];
        assert_int_equal(cbor_array_size(list), node[k].slots);
        for (size_t l = 0; l < cbor_array_size(list); l++) {
            assert_int_equal(cbor_get_int(cbor_array_handle(list)[l]), node[k].slot[l]);
            assert_int_equal(cbor_get_int(cbor_array_handle(rows)[node[k].slot[l]]), node[k].rows[l]);
        }
        assert_int_equal(node[k].slot[0], k);
        assert_int_equal(cbor_get_int(member(header, "states")), node[k].states);
    }
    cbor_decref(&header);
}

/* What arrived, as frames. The radio keeps no order: every other step backwards; every third frame comes twice. */
static int exchange(int t, int stage, const uint8_t *arrived) {
    uint8_t bytes[NODES][MK_FRAME_PLAIN + LARGEST * sizeof(real_t)];
    size_t size[NODES];
    int lost = 0;
    for (int k = 0; k < NODES; k++) size[k] = node[k].frame(stage, bytes[k]);
    for (int k = 0; k < NODES; k++) {
        for (int i = 1; i < node[k].slots; i++) {
            const int l = t % 2 ? node[k].slots - i : i, from = node[k].slot[l];
            if (arrived[slots_before(k) + l]) assert_int_equal(node[k].accept(bytes[from], size[from]), MK_OK);
            else lost++;
            if (arrived[slots_before(k) + l] && (t + l) % 3 == 0)
                assert_int_equal(node[k].accept(bytes[from], size[from]), MK_ERROR_REPEATED);
        }
    }
    return lost;
}

/* Every number that a node tells, before and after each step, as bytes: 0.0 and -0.0 differ too. */
static void same_bits(void **unused) {
    (void)unused;
    const size_t n = (size_t)node[0].states, all_slots = (size_t)slots_before(NODES);
    int first_row[NODES + 1] = {0}, lost = 0;
    for (int k = 0; k < NODES; k++) first_row[k + 1] = first_row[k] + node[k].rows[0];
    const size_t all_rows = (size_t)first_row[NODES];
    double *y = malloc(all_rows * sizeof *y);
#ifdef HEADER_FROZEN
    uint8_t frozen[NODES], was_frozen[NODES] = {0};
    int switches = 0;
#endif
    uint8_t *have_y = malloc(all_slots), *have_psi = malloc(all_slots);
    real_t *innovation = malloc(2 * all_rows * sizeof *innovation), *innovation_variance = innovation + all_rows, variance[NODES * LARGEST];
    real_t r[LARGEST], S[MK_PACKED(LARGEST)];
    uint8_t filled[LARGEST];
    real_t estimate[NODES * LARGEST], theta[NODES], tolerance[NODES], nis[NODES], trace[NODES], V[MK_PACKED(LARGEST)];
    uint32_t rows[NODES], faults[NODES];
    at = 0;
    cbor_item_t *item = next_item();
    cbor_decref(&item);
    for (int k = 0; k < NODES; k++) assert_int_equal(node[k].start(), MK_OK);
    for (int t = 0; t < STEPS; t++) {
        item = next_item();
        assert_int_equal(cbor_get_int(member(item, "step")), t);
        numbers(item, "measurements", FLOAT64_TAG, y, all_rows * sizeof *y);
        numbers(item, "measurements_arrived", UINT8_TAG, have_y, all_slots);
        numbers(item, "estimates_arrived", UINT8_TAG, have_psi, all_slots);
        numbers(item, "estimate", REAL_TAG, estimate, NODES * n * sizeof(real_t));
        numbers(item, "variance", REAL_TAG, variance, NODES * n * sizeof(real_t));
        numbers(item, "innovation", REAL_TAG, innovation, all_rows * sizeof(real_t));
        numbers(item, "innovation_variance", REAL_TAG, innovation_variance, all_rows * sizeof(real_t));
        numbers(item, "trace_covariance", REAL_TAG, trace, sizeof trace);
        numbers(item, "theta", REAL_TAG, theta, sizeof theta);
        numbers(item, "tolerance", REAL_TAG, tolerance, sizeof tolerance);
        numbers(item, "nis", REAL_TAG, nis, sizeof nis);
        numbers(item, "nis_rows", UINT32_TAG, rows, sizeof rows);
        numbers(item, "faults", UINT32_TAG, faults, sizeof faults);
#ifdef HEADER_FROZEN
        numbers(item, "frozen", UINT8_TAG, frozen, sizeof frozen);
#endif
        cbor_decref(&item);
        for (int k = 0; k < NODES; k++) {
            real_t sum = 0;
            assert_memory_equal(node[k].x, estimate + (size_t)k * n, n * sizeof(real_t));
            assert_int_equal(node[k].covariance(V), MK_OK);
            for (int i = 0; i < (int)n; i++) {
                assert_memory_equal(&V[MK_PACKED(i) + i], &variance[k * (int)n + i], sizeof sum);
                sum += V[MK_PACKED(i) + i];
            }
            assert_memory_equal(&sum, &trace[k], sizeof sum);
            /* Beyond a sensor's own rows anything may stand. */
            real_t reading[LARGEST];
            for (int r = 0; r < node[k].rows_most; r++)
                reading[r] = r < node[k].rows[0] ? (real_t)y[first_row[k] + r] : (real_t)NAN;
            if (have_y[slots_before(k)]) assert_int_equal(node[k].measure(reading), MK_OK);
        }
        lost += exchange(t, MK_STAGE_MEASUREMENT, have_y);
        for (int k = 0; k < NODES; k++) {
            assert_int_equal(node[k].innovations(r, S, filled), MK_OK);
            assert_int_equal(filled[0], have_y[slots_before(k)] ? node[k].rows[0] : 0);
            for (int i = 0; i < node[k].rows[0]; i++) {
                const int row = first_row[k] + i;
                assert_int_equal(!isnan(innovation[row]), filled[0] > 0);
                if (!filled[0]) continue;
                assert_memory_equal(&r[i], &innovation[row], sizeof r[i]);
                assert_memory_equal(&S[MK_PACKED(i) + i], &innovation_variance[row], sizeof r[i]);
            }
        }
        for (int k = 0; k < NODES; k++) assert_int_equal(node[k].incremental(), MK_OK);
        lost += exchange(t, MK_STAGE_ESTIMATE, have_psi);
        for (int k = 0; k < NODES; k++) {
            assert_int_equal(node[k].diffuse(), MK_OK);
            assert_memory_equal(&node[k].core->theta, &theta[k], sizeof theta[k]);
            assert_memory_equal(&node[k].core->tolerance, &tolerance[k], sizeof tolerance[k]);
            assert_memory_equal(&node[k].core->nis, &nis[k], sizeof nis[k]);
            assert_int_equal(node[k].core->nis_rows, rows[k]);
            assert_int_equal(node[k].core->faults, faults[k]);
#ifdef HEADER_FROZEN
            assert_int_equal(node[k].core->frozen, frozen[k]);
            switches += t > 0 && frozen[k] != was_frozen[k];
            was_frozen[k] = frozen[k];
#else
            assert_int_equal(node[k].core->frozen, 0);
#endif
        }
    }
    item = next_item();
    assert_memory_equal(cbor_string_handle(member(item, "end")), "complete", strlen("complete"));
    assert_int_equal(cbor_get_int(member(item, "items")), STEPS);
    cbor_decref(&item);
    assert_int_equal(at, length);
    /* Without losses, and with theta 0, half of the code would not have been compared. */
#ifdef HEADER_FROZEN
    assert_true(lost > STEPS / 10 && switches > STEPS / 10);
#else
    assert_true(lost > STEPS);
#endif
    assert_true(node[0].core->theta > (real_t)0);
    free(y);
    free(innovation);
    free(have_y);
    free(have_psi);
}

int main(void) {
    read_log(HEADER_LOG);
    const struct CMUnitTest tests[] = {cmocka_unit_test(same_network), cmocka_unit_test(same_bits)};
    const int failed = cmocka_run_group_tests_name(HEADER_LOG, tests, NULL, NULL);
    free(text);
    return failed;
}
