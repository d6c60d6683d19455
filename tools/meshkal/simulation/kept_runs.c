/* SPDX-License-Identifier: MIT */
#include "simulation/kept_runs.h"

#include <cbor.h>
#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "cbor_out.h"

static const char format[] = "meshkal-runs";
static const char record_start[] = "\xa3\x66" "filter"; /* a map of three, its first key */

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
    const cbor_item_t *run = member(item, "run"), *filter = member(item, "filter");
    if (filter && !is_text(filter, kept->filter)) return 1;
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
        if (!item && *good == 0) return mk_fail(error, "%s: not a file of kept runs", kept->path);
        if (!item) {
            const size_t left = length - *good, start = sizeof record_start - 1;
            return (result.error.code == CBOR_ERR_NOTENOUGHDATA && memcmp(data + *good, record_start, left < start ? left : start) == 0) ||
                   mk_fail(error, "%s: damaged after byte %zu: what stands before it can be kept", kept->path, *good);
        }
        int fine = 1;
        if (*good > 0) fine = take_record(kept, item, error);
        else if (!is_text(member(item, "format"), format)) fine = mk_fail(error, "%s: not a file of kept runs", kept->path);
        else if (!is_text(member(item, "campaign"), campaign))
            fine = mk_fail(error, "%s: holds runs of another campaign (scenario, seed, steps, tolerance, loss, precision, monitor or truth differ)",
                           kept->path);
        cbor_decref(&item);
        if (!fine) return 0;
        *good += result.read;
    }
    return 1;
}

static int write_item(mk_kept_t *kept, const mk_cbor_t *item, mk_error_t *error) {
    const int good = fwrite(item->buffer, 1, item->used, kept->stream) == item->used && fflush(kept->stream) == 0;
    return good || mk_fail(error, "%s: %s", kept->path, strerror(errno));
}

/* The file for this process alone, and what it holds; free that. Null and an error on failure. */
static char *take_file(mk_kept_t *kept, size_t *length, mk_error_t *error) {
    struct stat there;
    /* Devices and pipes may never end. */
    if (stat(kept->path, &there) == 0 && !S_ISREG(there.st_mode)) {
        (void)mk_fail(error, "%s: not a plain file", kept->path);
        return NULL;
    }
    kept->stream = fopen(kept->path, "a+b");
    struct flock lock;
    memset(&lock, 0, sizeof lock);
    lock.l_type = F_WRLCK;
    lock.l_whence = SEEK_SET;
    if (kept->stream && fcntl(fileno(kept->stream), F_SETLK, &lock) != 0 && (errno == EACCES || errno == EAGAIN)) {
        (void)mk_fail(error, "%s: another campaign is writing to it", kept->path);
        return NULL;
    }
    if (!kept->stream || fstat(fileno(kept->stream), &there) != 0) {
        (void)mk_fail(error, "%s: %s", kept->path, strerror(errno));
        return NULL;
    }
    *length = (size_t)there.st_size;
    char *data = mk_allocate(*length, 1);
    rewind(kept->stream);
    if (fread(data, 1, *length, kept->stream) == *length && fseek(kept->stream, 0, SEEK_END) == 0) return data;
    (void)mk_fail(error, "%s: %s", kept->path, strerror(ferror(kept->stream) ? errno : EIO));
    free(data);
    return NULL;
}

int mk_kept_open(mk_kept_t *kept, const char *path, const char *campaign, const char *filter, size_t count, mk_error_t *error) {
    const int is_new = access(path, F_OK) != 0;
    size_t length = 0, good = 0;
    mk_cbor_t head = {NULL, 0, 0};
    memset(kept, 0, sizeof *kept);
    kept->path = path;
    kept->filter = filter;
    kept->count = count;
    mk_cbor_map(&head, 3);
    mk_cbor_pair(&head, "format", format);
    mk_cbor_count(&head, "format_version", 1);
    mk_cbor_pair(&head, "campaign", campaign);
    char *data = take_file(kept, &length, error);
    const int has_head = data && !(length < head.used && memcmp(data, head.buffer, length) == 0);
    int fine = data && (!has_head || read_items(kept, campaign, data, length, &good, error));
    if (fine && good < length && ftruncate(fileno(kept->stream), (off_t)good) != 0) fine = mk_fail(error, "%s: %s", path, strerror(errno));
    if (fine && !has_head) fine = write_item(kept, &head, error);
    if (!fine && is_new && kept->stream) (void)remove(path);
    free(data);
    free(head.buffer);
    if (!fine) mk_kept_close(kept);
    return fine;
}

int mk_kept_add(mk_kept_t *kept, int run, const double *record, mk_error_t *error) {
    mk_cbor_t out = {NULL, 0, 0};
    mk_cbor_map(&out, 3);
    mk_cbor_pair(&out, "filter", kept->filter);
    mk_cbor_count(&out, "run", (uint64_t)run);
    mk_cbor_typed(&out, "record", MK_CBOR_FLOAT64, record, sizeof *record, kept->count);
    const int good = write_item(kept, &out, error);
    free(out.buffer);
    return good;
}

void mk_kept_close(mk_kept_t *kept) {
    if (kept->stream) (void)fclose(kept->stream);
    free(kept->records);
    memset(kept, 0, sizeof *kept);
}
