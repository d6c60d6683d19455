/* SPDX-License-Identifier: MIT */
#include "kept_runs.h"

#include <cbor.h>
#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "cbor_out.h"
#include "file.h"

static const char format[] = "meshkal-runs";

/* Value of a text key in a map of definite texts; null if there is none. */
static const cbor_item_t *member(const cbor_item_t *map, const char *key) {
    if (!cbor_isa_map(map)) return NULL;
    const struct cbor_pair *pair = cbor_map_handle(map);
    for (size_t i = 0; i < cbor_map_size(map); i++) {
        const cbor_item_t *name = pair[i].key;
        if (cbor_isa_string(name) && cbor_string_is_definite(name) && cbor_string_length(name) == strlen(key) &&
            memcmp(cbor_string_handle(name), key, strlen(key)) == 0)
            return pair[i].value;
    }
    return NULL;
}

static int is_text(const cbor_item_t *item, const char *text) {
    return item && cbor_isa_string(item) && cbor_string_is_definite(item) && cbor_string_length(item) == strlen(text) &&
           memcmp(cbor_string_handle(item), text, strlen(text)) == 0;
}

/* A float64 array of this many numbers; null if it is not. The bytes are little-endian, as on every host this is built for. */
static const unsigned char *numbers(const cbor_item_t *item, size_t count) {
    if (!item || !cbor_isa_tag(item) || cbor_tag_value(item) != MK_CBOR_FLOAT64) return NULL;
    cbor_item_t *bytes = cbor_tag_item(item);
    const int good = cbor_isa_bytestring(bytes) && cbor_bytestring_is_definite(bytes) && cbor_bytestring_length(bytes) == count * sizeof(double);
    const unsigned char *handle = good ? cbor_bytestring_handle(bytes) : NULL;
    cbor_decref(&bytes); /* cbor_tag_item counts; the tag keeps it alive */
    return handle;
}

static int take_record(mk_kept_t *kept, const cbor_item_t *item, mk_error_t *error) {
    const cbor_item_t *run = member(item, "run");
    if (!is_text(member(item, "filter"), kept->filter)) return 1;
    const unsigned char *bytes = numbers(member(item, "record"), kept->count);
    if (!run || !cbor_isa_uint(run) || !bytes || cbor_get_int(run) != (uint64_t)kept->runs)
        return mk_fail(error, "%s: the record of run %d of %s is damaged", kept->path, kept->runs, kept->filter);
    double *larger = realloc(kept->records, ((size_t)kept->runs + 1) * kept->count * sizeof *larger);
    if (!larger) return mk_fail(error, "%s: out of memory", kept->path);
    kept->records = larger;
    memcpy(larger + (size_t)kept->runs * kept->count, bytes, kept->count * sizeof *larger);
    kept->runs++;
    return 1;
}

/* Reads whole items from the start; *good: where the last of them ends. */
static int read_items(mk_kept_t *kept, const char *campaign, const char *data, size_t length, size_t *good, mk_error_t *error) {
    for (*good = 0; *good < length;) {
        struct cbor_load_result result;
        cbor_item_t *item = cbor_load((const unsigned char *)data + *good, length - *good, &result);
        if (!item) {
            if (*good > 0) return 1;
            return mk_fail(error, "%s: not a file of kept runs", kept->path);
        }
        int fine = 1;
        if (*good > 0) fine = take_record(kept, item, error);
        else if (!is_text(member(item, "format"), format)) fine = mk_fail(error, "%s: not a file of kept runs", kept->path);
        else if (!is_text(member(item, "campaign"), campaign))
            fine = mk_fail(error, "%s: holds runs of another campaign (scenario, seed, steps, tolerance, loss, precision or truth differ)", kept->path);
        cbor_decref(&item);
        if (!fine) return 0;
        *good += result.read;
    }
    return 1;
}

static int write_item(mk_kept_t *kept, mk_cbor_t *out, mk_error_t *error) {
    const int good = fwrite(out->buffer, 1, out->used, kept->stream) == out->used && fflush(kept->stream) == 0;
    const int cause = errno;
    free(out->buffer);
    return good || mk_fail(error, "%s: %s", kept->path, strerror(cause));
}

int mk_kept_open(mk_kept_t *kept, const char *path, const char *campaign, const char *filter, size_t count, mk_error_t *error) {
    memset(kept, 0, sizeof *kept);
    kept->path = path;
    kept->filter = filter;
    kept->count = count;
    kept->stream = fopen(path, "ab");
    if (!kept->stream) return mk_fail(error, "%s: %s", path, strerror(errno));
    size_t length = 0, good = 0;
    char *data = mk_read_file(path, &length, error);
    int fine = data && read_items(kept, campaign, data, length, &good, error);
    free(data);
    if (fine && good < length && ftruncate(fileno(kept->stream), (off_t)good) != 0) fine = mk_fail(error, "%s: %s", path, strerror(errno));
    if (fine && good == 0) {
        mk_cbor_t out = {NULL, 0, 0};
        mk_cbor_map(&out, 3);
        mk_cbor_pair(&out, "format", format);
        mk_cbor_count(&out, "format_version", 1);
        mk_cbor_pair(&out, "campaign", campaign);
        fine = write_item(kept, &out, error);
    }
    if (!fine) mk_kept_close(kept);
    return fine;
}

int mk_kept_add(mk_kept_t *kept, int run, const double *record, mk_error_t *error) {
    mk_cbor_t out = {NULL, 0, 0};
    mk_cbor_map(&out, 3);
    mk_cbor_pair(&out, "filter", kept->filter);
    mk_cbor_count(&out, "run", (uint64_t)run);
    mk_cbor_typed(&out, "record", MK_CBOR_FLOAT64, record, sizeof *record, kept->count);
    return write_item(kept, &out, error);
}

void mk_kept_close(mk_kept_t *kept) {
    if (kept->stream) (void)fclose(kept->stream);
    free(kept->records);
    memset(kept, 0, sizeof *kept);
}
