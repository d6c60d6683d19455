/* SPDX-License-Identifier: MIT */
#include "file.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

char *mk_read_file(const char *path, size_t *length, mk_error_t *error) {
    FILE *stream = fopen(path, "rb");
    if (!stream) {
        (void)mk_fail(error, "%s: %s", path, strerror(errno));
        return NULL;
    }
    size_t room = 1 << 16, used = 0;
    char *text = mk_allocate(room, 1);
    for (;;) {
        used += fread(text + used, 1, room - used - 1, stream);
        if (used < room - 1) break;
        char *larger = realloc(text, room *= 2);
        if (!larger) {
            free(text);
            (void)fclose(stream);
            (void)mk_fail(error, "%s: too large for memory", path);
            return NULL;
        }
        text = larger;
    }
    const int failed = ferror(stream);
    (void)fclose(stream);
    if (failed) {
        (void)mk_fail(error, "%s: %s", path, strerror(errno));
        free(text);
        return NULL;
    }
    text[used] = 0;
    *length = used;
    return text;
}

int mk_open_output(mk_output_t *output, const char *path, mk_error_t *error) {
    const size_t room = strlen(path) + 10;
    struct stat there;
    output->path = mk_allocate(room, 1);
    output->partial = NULL;
    (void)snprintf(output->path, room, "%s", path);
    if (lstat(path, &there) != 0 || S_ISREG(there.st_mode)) {
        output->partial = mk_allocate(room, 1);
        (void)snprintf(output->partial, room, "%s.partial", path);
    }
    output->stream = fopen(output->partial ? output->partial : path, "wb");
    if (output->stream) return 1;
    const int reason = errno;
    free(output->path);
    free(output->partial);
    return mk_fail(error, "%s: %s", path, strerror(reason));
}

int mk_close_output(mk_output_t *output, int keep, mk_error_t *error) {
    int good = !ferror(output->stream);
    good &= fclose(output->stream) == 0;
    if (good && keep && output->partial) good = rename(output->partial, output->path) == 0;
    if (keep && !good) (void)mk_fail(error, "%s: %s", output->path, strerror(errno));
    if (output->partial && !(keep && good)) (void)remove(output->partial);
    free(output->path);
    free(output->partial);
    return good || !keep;
}
