/* SPDX-License-Identifier: MIT */
#include <stdlib.h>
#include <unistd.h>

#include "daemon.h"
#include "file.h"

int mk_daemon_restore(mk_daemon_t *d) {
    const char *path = d->settings.state;
    mk_error_t why;
    size_t length;
    if (!path) return 0;
    if (access(path, F_OK) != 0) {
        mk_daemon_say(d, "%s: not there yet: starting from x0 and P0", path);
        return 0;
    }
    char *blob = mk_read_file(path, &length, &why);
    if (!blob) {
        mk_daemon_say(d, "%s: starting from x0 and P0", why.text);
        return 0;
    }
    const mk_status_t status = d->kind->restore(d->object, (const uint8_t *)blob, length);
    free(blob);
    if (status == MK_OK) mk_daemon_say(d, "%s: state restored", path);
    else mk_daemon_say(d, "%s: no state of this node (%s): starting from x0 and P0", path, mk_status_name(status));
    return status == MK_OK;
}

void mk_daemon_save(mk_daemon_t *d) {
    mk_output_t file;
    mk_error_t error;
    const size_t length = d->settings.state ? d->kind->save(d->object, d->blob) : 0;
    if (length == 0) return;
    /* Not forced to the disk, which may take long: what a failure of power leaves is told by its CRC. */
    if (mk_open_output(&file, d->settings.state, &error)) {
        const int good = fwrite(d->blob, 1, length, file.stream) == length;
        if (mk_close_output(&file, good, &error) && good) return;
        if (!good) (void)mk_fail(&error, "%s: cannot be written", d->settings.state);
    }
    if (d->tally.unsaved++ < 10) mk_daemon_say(d, "%s", error.text);
}
