/* SPDX-License-Identifier: MIT */
/* The commands of build/meshkal. Each gets its own arguments, argv[0] being its name, and returns the exit status: 0, 1 (failed), 2 (wrong
   input or arguments, nothing written). */
#ifndef MESHKAL_COMMANDS_H
#define MESHKAL_COMMANDS_H

#include "error.h"

int mk_command_design(int argc, char **argv);
/* By all processes of a team together; null: this one alone. */
struct mk_team;
int mk_command_simulate(int argc, char **argv, struct mk_team *team);
int mk_command_analyze(int argc, char **argv);
int mk_command_fit(int argc, char **argv);
int mk_command_scenario(int argc, char **argv);
int mk_command_replay(int argc, char **argv);
int mk_command_draw(int argc, char **argv);

enum { MK_EXIT_FAILED = 1, MK_EXIT_INPUT = 2 };

/* One option: --name, or --name VALUE where `value` is not null. */
typedef struct {
    const char *name;
    const char **value;
    int *flag;
} mk_option_t;

/* Sorts arguments into options and at most one other argument, which is required. 1, or 0 and *error. */
int mk_parse_options(int argc, char **argv, const mk_option_t *options, const char *what, const char **other, mk_error_t *error);

/* Values of options; null text leaves the default in *value. 1, or 0 and *error. */
int mk_option_integer(const char *name, const char *text, long long least, long long most, long long *value, mk_error_t *error);
int mk_option_real(const char *name, const char *text, double least, double most, double *value, mk_error_t *error);

/* Prints "meshkal: message" to standard error and returns status. */
int mk_complain(const mk_error_t *error, int status);
/* At the end: status, or FAILED with a complaint if what went to standard output did not arrive. */
int mk_finish(int status);

#endif
