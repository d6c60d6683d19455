/* SPDX-License-Identifier: MIT */
/* A node of a simulated network, on the target: its record (meshkal simulate --record), which is in the image, is run again through the
   typed functions of its header (meshkal design --c-header), and everything that came of it there has to come of it here, to the bit.
   Command line: NAME [PATH]. With a path the node is recorded again, and this record written there: it has to be the same, to the byte.
   REPLAY_BITS is 32 or 64. */
#include <string.h>

#include <meshkal/network/bytes.h>

#include "node_00.h"
#include "replay_data.h" /* replay_record, replay_size */
#include "semihost.h"

#if REPLAY_BITS == 32
typedef mk_f32_t real_t;
typedef uint32_t bits_t;
#else
typedef mk_f64_t real_t;
typedef uint64_t bits_t;
#endif

enum { N = sizeof((node00_t *)0)->filter.x / sizeof(real_t), ROWS = sizeof((node00_t *)0)->filter.y / sizeof(real_t) };
enum { NUMBERS = N + MK_PACKED(N) > ROWS ? N + MK_PACKED(N) : ROWS };

static node00_t node;
static uint8_t room[6144];
static mk_recorder_t recorder = {room, sizeof room, 0, 0, 1};
static int out = -1;
static uint32_t item, offset, step, compared; /* step: that the node works on when the item comes */

static void fail(const char *what) {
    mk_write("item ");
    mk_write_number(item);
    mk_write(" at byte ");
    mk_write_number(offset);
    mk_write(", step ");
    mk_write_number(step);
    mk_write(": ");
    mk_write(what);
}

/* Ends the image at the first difference. */
static void same(const char *what, int element, uint64_t here, uint64_t recorded, int digits) {
    compared++;
    if (here == recorded) return;
    fail(what);
    if (element >= 0) {
        mk_write("[");
        mk_write_number((uint32_t)element);
        mk_write("]");
    }
    mk_write(" differs: here 0x");
    mk_write_hex(here, digits);
    mk_write(", recorded 0x");
    mk_write_hex(recorded, digits);
    mk_write("\n");
    mk_exit(1);
}

static void must(int good, const char *what) {
    if (good) return;
    fail(what);
    mk_write("\n");
    mk_exit(1);
}

static void same_numbers(const char *what, const real_t *here, const uint8_t *recorded) {
    for (int i = 0; i < (int)N; i++) {
        bits_t bits;
        memcpy(&bits, &here[i], sizeof bits);
        same(what, i, bits, mk_get_bytes(recorded + (size_t)i * sizeof bits, sizeof bits), REPLAY_BITS / 4);
    }
}

static const real_t *numbers(const uint8_t *from, size_t count) {
    static real_t values[NUMBERS];
    for (size_t i = 0; i < count; i++) {
        const bits_t bits = (bits_t)mk_get_bytes(from + i * sizeof bits, sizeof bits);
        memcpy(&values[i], &bits, sizeof bits);
    }
    return values;
}

/* A record holds no checksums of frames: this one passed when it arrived. */
static mk_status_t accept(const mk_item_t *it) {
    static uint8_t bytes[MK_FRAME_PLAIN + 8 * MK_NODE_NUMBERS(N, ROWS)];
    must(it->length + 4 <= sizeof bytes, "frame too long");
    memcpy(bytes, it->content, it->length);
    mk_put_u32(bytes + it->length, mk_crc32(0, bytes, it->length));
    return node00_accept(&node, bytes, it->length + 4);
}

static void begin(const mk_item_t *it) {
    must(node00_restore(&node, &node00_config, it->content, it->length) == MK_OK, "this state is not one of node 0");
    if (out >= 0) must(node00_record(&node, &recorder) == MK_OK, "the recorder has no room for a state");
}

/* Items that a simulated node writes; an application's own may also hold advance and restart. */
static void play(const mk_item_t *it) {
    const uint8_t *const content = it->content;
    const size_t size = N * sizeof(real_t), psi = it->status == MK_OK ? size : 0;
    mk_status_t status = MK_OK;
    step = node.node.step;
    if (it->kind == MK_ITEM_MEASURE) status = node00_measure(&node, numbers(content, it->length / sizeof(real_t)));
    else if (it->kind == MK_ITEM_FRAME) status = accept(it);
    else if (it->kind == MK_ITEM_INCREMENTAL)
        status = it->length > psi ? node00_incremental_with(&node, numbers(content, N)) : node00_incremental(&node);
    else if (it->kind == MK_ITEM_DIFFUSE) status = node00_diffuse(&node);
    else if (it->kind == MK_ITEM_TOLERANCE) status = node00_set_tolerance(&node, *numbers(content, 1));
    else if (it->kind == MK_ITEM_DROP) status = node00_drop(&node, mk_get_u16(content));
    else must(0, "an item that this image does not know");
    same("status", -1, (uint64_t)status, it->status, 2);
    if (it->kind == MK_ITEM_INCREMENTAL && psi) same_numbers("psi", node00_intermediate(&node), content + it->length - size);
    if (it->kind != MK_ITEM_DIFFUSE) return;
    same("step", -1, node.node.step, mk_get_u32(content), 8);
    same_numbers("x", node00_estimate(&node), content + 4);
}

/* A stream: what waits is taken out between calls. */
static void drain(void) {
    must(recorder.lost == 0, "the recorder lost an item");
    must(mk_file_write(out, recorder.bytes, (uint32_t)recorder.used) == recorder.used, "the record cannot be written");
    recorder.used = 0;
}

int main(void) {
    char line[256];
    (void)mk_command_line(line, sizeof line);
    const char *const path = strchr(line, ' ');
    if (path) out = mk_file_open(path + 1, MK_FILE_WRITE);
    must(!path || out >= 0, "the record cannot be opened");
    while (offset < replay_size) {
        mk_item_t it;
        int damaged;
        const size_t length = mk_item_read(replay_record + offset, replay_size - offset, &it, &damaged);
        must(length > 0, damaged ? "damaged" : "cut off");
        if (it.kind == MK_ITEM_STATE) begin(&it);
        else if (it.kind != MK_ITEM_CONFIGURATION) play(&it);
        if (out >= 0 && recorder.used > sizeof room / 2) drain();
        item++;
        offset += (uint32_t)length;
    }
    if (out >= 0) {
        drain();
        must(mk_file_close(out) == 0, "the record cannot be closed");
    }
    must(node.node.step == REPLAY_STEPS, "not the steps that were expected");
    mk_write_number(compared);
    mk_write(" values agree\n");
    return 0;
}
