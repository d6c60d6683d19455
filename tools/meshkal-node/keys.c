/* SPDX-License-Identifier: MIT */
#include "keys.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "clock.h"
#include "file.h"

static int digit(char c) {
    const char *const digits = "0123456789abcdef", *place = c ? strchr(digits, c >= 'A' && c <= 'F' ? c + ('a' - 'A') : c) : NULL;
    return place ? (int)(place - digits) : -1;
}

static int read_key(mk_keys_t *keys, const mk_settings_t *s, mk_error_t *error) {
    struct stat there;
    size_t length;
    mk_error_t why;
    if (stat(s->key, &there) == 0 && there.st_mode & 077)
        return mk_settings_bad(s, "security.key_file", error, "%.200s can be read by others than its owner: chmod 600", s->key);
    char *text = mk_read_file(s->key, &length, &why);
    if (!text) return mk_settings_bad(s, "security.key_file", error, "%s", why.text);
    int good = 1;
    for (int i = 0; i < MK_AEAD_KEY && good; i++) {
        const int high = digit(text[2 * i]), low = high < 0 ? -1 : digit(text[2 * i + 1]);
        good = low >= 0;
        keys->key[i] = (uint8_t)(good ? 16 * high + low : 0);
    }
    good = good && text[2 * MK_AEAD_KEY + strspn(text + 2 * MK_AEAD_KEY, " \r\n")] == 0;
    memset(text, 0, length);
    free(text);
    return good || mk_settings_bad(s, "security.key_file", error, "%.200s: must hold %d hexadecimal digits", s->key, 2 * MK_AEAD_KEY);
}

/* Takes the next start. */
static int take_boot(mk_keys_t *keys, const mk_settings_t *s, mk_error_t *error) {
    struct flock lock;
    char text[32] = "";
    keys->boots = open(s->boots, O_RDWR | O_CREAT | O_CLOEXEC, 0600);
    if (keys->boots < 0) return mk_settings_bad(s, "security.boot_file", error, "%.200s: %s", s->boots, strerror(errno));
    memset(&lock, 0, sizeof lock);
    lock.l_type = F_WRLCK;
    lock.l_whence = SEEK_SET;
    if (fcntl(keys->boots, F_SETLK, &lock) != 0)
        return mk_settings_bad(s, "security.boot_file", error, "%.200s: %s", s->boots,
                               errno == EACCES || errno == EAGAIN ? "another node runs with it" : strerror(errno));
    const ssize_t length = read(keys->boots, text, sizeof text - 1);
    char *end = text;
    const unsigned long long last = length > 0 ? strtoull(text, &end, 10) : 0;
    if (length < 0 || end[strspn(end, "\n")] || last >= UINT32_MAX)
        return mk_settings_bad(s, "security.boot_file", error, "%.200s: must hold the number of the last start, below 2^32 - 1", s->boots);
    const uint64_t seconds = (uint64_t)(mk_clock_now() / 1000000000), boot = last + 1 > seconds ? last + 1 : seconds;
    const int written = snprintf(text, sizeof text, "%llu\n", (unsigned long long)boot);
    /* In place: numbers only grow, so none leaves digits of a longer one behind. */
    if (pwrite(keys->boots, text, (size_t)written, 0) != written || fsync(keys->boots) != 0)
        return mk_settings_bad(s, "security.boot_file", error, "%.200s: %s", s->boots, strerror(errno));
    keys->sequence = boot << 32;
    return 1;
}

int mk_keys_open(mk_keys_t *keys, const mk_settings_t *s, mk_error_t *error) {
    memset(keys, 0, sizeof *keys);
    keys->boots = -1;
    if (!s->key) return 1;
    if (read_key(keys, s, error) && mk_aead_sodium(&keys->aead, keys->key, error) && take_boot(keys, s, error)) return 1;
    mk_keys_close(keys);
    return 0;
}

void mk_keys_close(mk_keys_t *keys) {
    mk_aead_forget(keys->key);
    if (keys->boots >= 0) (void)close(keys->boots);
    keys->boots = -1;
}
