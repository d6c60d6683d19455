/* SPDX-License-Identifier: MIT */
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "commands.h"

int mk_parse_options(int argc, char **argv, const mk_option_t *options, const char *what, const char **other, mk_error_t *error) {
    *other = NULL;
    for (int i = 1; i < argc; i++) {
        if (strncmp(argv[i], "--", 2) != 0) {
            if (*other) return mk_fail(error, "%s: unexpected argument %s", argv[0], argv[i]);
            *other = argv[i];
            continue;
        }
        const mk_option_t *option = options;
        while (option->name && strcmp(option->name, argv[i] + 2) != 0) option++;
        if (!option->name) return mk_fail(error, "%s: unknown option %s (meshkal help lists them)", argv[0], argv[i]);
        if (option->flag) *option->flag = 1;
        else if (i + 1 < argc && strncmp(argv[i + 1], "--", 2) != 0) *option->value = argv[++i];
        else return mk_fail(error, "%s: option %s needs a value", argv[0], argv[i]);
    }
    return *other ? 1 : mk_fail(error, "%s: %s is missing", argv[0], what);
}

int mk_option_integer(const char *name, const char *text, long long least, long long most, long long *value, mk_error_t *error) {
    if (!text) return 1;
    char *end;
    errno = 0;
    *value = strtoll(text, &end, 10);
    if (end == text || *end || errno || *value < least || *value > most)
        return mk_fail(error, "--%s %s: must be an integer from %lld to %lld", name, text, least, most);
    return 1;
}

int mk_option_real(const char *name, const char *text, double least, double most, double *value, mk_error_t *error) {
    if (!text) return 1;
    char *end;
    *value = strtod(text, &end);
    if (end == text || *end || !(*value >= least && *value <= most))
        return mk_fail(error, "--%s %s: must be a number from %g to %g", name, text, least, most);
    return 1;
}

int mk_finish(int status) {
    const int arrived = fflush(stdout) == 0 && !ferror(stdout);
    if (status || arrived) return status;
    (void)fprintf(stderr, "meshkal: standard output: %s\n", strerror(errno));
    return MK_EXIT_FAILED;
}

int mk_complain(const mk_error_t *error, int status) {
    (void)fprintf(stderr, "meshkal: %s\n", error->text);
    return status;
}
