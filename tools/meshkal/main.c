/* SPDX-License-Identifier: MIT */
#include <meshkal/base.h>
#include <stdio.h>
#include <string.h>

#include "commands.h"

static const char title[] = "meshkal " MK_VERSION ": design and simulate networks of robust Kalman filters\n";

static const char design_help[] =
    "meshkal design SCENARIO.json [options]      local tolerances and steady state of every node\n"
    "    --json FILE          results for programs\n"
    "    --c-header DIR       node_NN.h for every node: constant configuration for firmware\n"
    "    --real float32|float64   precision of the headers (default float64)\n"
    "    --frozen CLOSE       headers with the constant gain of the limit, used while the covariance is so close to its limit (1e-3: a thousandth)\n"
    "    --per-step T         also c_k(t) for T steps, into the JSON file\n"
    "    --tolerance C        instead of the scenario's\n"
    "    --c-max none|central|all   guaranteed tolerances (default: all up to 200 nodes, else central)\n"
    "    --covariances        P and V of every node into the JSON file, above 10 000 nodes, too\n"
    "    --threads N          (default: all cores)\n"
    "    --allow-unobservable     go on when a node does not see all states\n"
    "of a scenario that tracks a target: convergence and speed of consensus on its graph, observability along a trajectory\n"
    "    --json --threads --allow-unobservable    as above; the last: exit status 0 though the network cannot work\n"
    "    --truth FILE.csv     along this one, columns t,state,value, instead of the mean trajectory from x0\n"
    "    --window W           steps over which information is collected (default 10)\n"
    "    --condition LIMIT    of the information's condition number, for warnings (default 1e6)\n"
    "    --runs M             drawn trajectories, in which sensors in range are counted (default 100, fewer if they are long)\n"
    "    --models FILE.so     own models (port/host/meshkal/plugin.h)\n";

static const char simulate_help[] =
    "meshkal simulate SCENARIO.json [options]    run the node code as a network\n"
    "    --filter F           kfc rkfc kfd rkfdu rkfdnu rkfdnu2 (default rkfdnu2), or all\n"
    "    --steps T --seed S --tolerance C         instead of the scenario's\n"
    "    --runs M             Monte Carlo runs (default 1)\n"
    "    --real float32|float64   precision of the nodes (default float64)\n"
    "    --loss P             probability that a message is lost\n"
    "    --frozen CLOSE       nodes freeze their gain as the headers of design --frozen CLOSE do\n"
    "    --arrivals FILE.csv  messages that arrived: columns t,stage,from,to, stage 1 readings, 2 estimates; the others are lost\n"
    "    --measurements FILE.csv  recorded instead of drawn: columns t,node,row,value\n"
    "    --truth nominal|least-favourable   model that is drawn from (default nominal)\n"
    "    --truth FILE.csv     recorded truth of recorded measurements: columns t,state,value\n"
    "    --horizon T          last step of the least favourable model (default: 100 after the run)\n"
    "    --monitor none|rctm|aime|aime-improved|exclude   each filter has its integrity monitor (meshkal/monitor.h; default none); what it is\n"
    "                         to find is in the scenario's \"faults\", which are added to readings, drawn or recorded\n"
    "    --window M --false-alarm P               of the monitors, instead of the scenario's\n"
    "    --out FILE           log of the run, CBOR; - is standard output\n"
    "    --record DIR         a record of every node in the first run, for meshkal replay and for firmware\n"
    "    --json FILE          summary for programs\n"
    "    --threads N          (default: all cores)\n"
    "    --resume FILE        complete runs are kept there; a later call goes on, also to more runs\n"
    "  of a tracking scenario (its model has \"motion\"): --steps --seed --runs --real --loss --measurements --truth FILE.csv --out --json --threads and\n"
    "    --filter F           central: ekf ukf iukf iukf-literal pukf mpukf, one in each node: duif kcf rekfd (default ukf), or all\n"
    "    --models FILE.so     own models, see meshkal/plugin.h\n"
    "    --from-step K        first step of RMSE, NEES and NIS, from 1 (default: the second half)\n"
    "    --lost-m D           count runs that end with a position error above D metres\n"
    "    --increments N --rule R --gate P|none --protocol C --iterations L --tolerance C    instead of the scenario's\n"
    "  of a navigation scenario (its model has \"navigation\"): --steps --seed --runs --real --from-step --monitor --window\n"
    "    --false-alarm --out --json --threads and\n"
    "    --filter F           ekf rekf-n rekf-t (default ekf), or all\n"
    "    --measurements FILE.csv  recorded pseudoranges: columns t,satellite,value,x,y,z (m; the satellite's place in the local frame, east,\n"
    "                         north, up; value less satellite clock and atmosphere); no or NaN value: none\n"
    "    --imu FILE.csv       and inertial samples: columns t,wx,wy,wz,fx,fy,fz (rad/s, m/s^2; right, forward, up; means over the interval\n"
    "                         that ends at t; without the Earth's rotation)\n"
    "    --truth FILE.csv     one line a time, columns as meshkal draw writes them\n";

static const char analyze_help[] =
    "meshkal analyze SCENARIO.json [options]     error of every filter when the model errs as badly as c allows, by covariances\n"
    "    --filter F           kfc rkfc kfd rkfdu rkfdnu rkfdnu2 (default rkfdnu2), or all\n"
    "    --truth least-favourable|nominal         (default least-favourable)\n"
    "    --horizon T          the model exists for t = 0 .. T; steady values are those at T / 2 (default 200)\n"
    "    --tolerance C        instead of the scenario's\n"
    "    --per-step           also tolerances and theta of every step, into the JSON file\n"
    "    --node K             also covariances of node K's error with its neighbours' and RKFC's, into the JSON file\n"
    "    --threads N          (default: all cores; the numbers do not depend on it)\n"
    "    --json FILE          results for programs\n";

static const char fit_help[] =
    "meshkal fit SCENARIO.json [options]         the tolerance that logged data ask for, and who is not as the model says\n"
    "    --states FILE.csv    logged true states: columns t,state,value\n"
    "    --measurements FILE.csv  logged readings: columns t,node,row,value\n"
    "    --steps T            the first T steps only\n"
    "    --level L            of intervals and tests (default 0.95)\n"
    "    --json FILE          results for programs\n";

static const char scenario_help[] =
    "meshkal scenario projectile [options]       a random draw of the published example, to standard output\n"
    "    --nodes N --seed S   (default 20 nodes, seed 1)\n"
    "    --density D          mean number of neighbours, the node itself included (default 5)\n"
    "meshkal scenario incomplete-measurements    a target and three ranges that fail, as published; to standard output\n"
    "meshkal scenario distributed-unscented      a target and three linked ranges, as published; to standard output\n"
    "    --range-limit R      metres that its sensors reach (default: all)\n"
    "meshkal scenario gnss-ins                   satellites and an inertial unit, as published, with a fault of 0.15 m/s on satellite 1; to standard output\n"
    "    Edit its keys for other ones: faults[0].rate, from_s, to_s; without \"faults\" there is none\n"
    "    These three: --seed S\n";

static const char draw_help[] =
    "meshkal draw SCENARIO.json [options]        truth and readings of one run of a tracking or navigation scenario, as CSV files\n"
    "    --measurements FILE.csv  columns t,node,row,value, t in seconds\n"
    "    --truth FILE.csv     columns t,state,value\n"
    "    --steps T --seed S   instead of the scenario's\n"
    "    --run R              number of the run, from 0 (default 0)\n"
    "    --models FILE.so     own models, see meshkal/plugin.h\n"
    "    --json FILE          initial estimate, counts and faults for programs\n"
    "  of a navigation scenario: --measurements --truth --steps --seed --run --json (its \"estimate\" goes into model.navigation.estimate) and\n"
    "    --imu FILE.csv       inertial samples; the files are those that simulate reads, without the faults, which it adds\n";

static const char replay_help[] =
    "meshkal replay RECORD [options]             run a node again from its record and compare every bit\n"
    "    --configuration RECORD   whose configuration counts in place of the record's own\n"
    "    --all                every difference, not the first only\n"
    "    --json FILE          results for programs\n"
    "    Exit status: 0 equal, also if its end is cut off; 1 different; 2 not readable; what stands before that is replayed\n";

static const char ending[] = "Exit status: 0; 1 the work failed; 2 wrong input or arguments, nothing written.\n";

/* simulate is here without its team of processes. */
static int simulate_alone(int argc, char **argv) { return mk_command_simulate(argc, argv, NULL); }

static const struct {
    const char *name, *help;
    int (*run)(int argc, char **argv);
} command[] = {
    {"design", design_help, mk_command_design},
    {"simulate", simulate_help, simulate_alone},
    {"analyze", analyze_help, mk_command_analyze},
    {"fit", fit_help, mk_command_fit},
    {"scenario", scenario_help, mk_command_scenario},
    {"draw", draw_help, mk_command_draw},
    {"replay", replay_help, mk_command_replay},
};
enum { COMMANDS = sizeof command / sizeof command[0] };

static int run(int argc, char **argv) {
    const char *name = argc > 1 ? argv[1] : "";
    int wants_help = strcmp(name, "help") == 0, found = COMMANDS;
    for (int i = 1; i < argc; i++) wants_help |= strcmp(argv[i], "--help") == 0 || strcmp(argv[i], "-h") == 0;
    for (int i = 0; i < COMMANDS; i++)
        if (strcmp(name, command[i].name) == 0) found = i;
    if (wants_help || argc < 2) {
        FILE *const to = wants_help ? stdout : stderr;
        if (found == COMMANDS) (void)fputs(title, to);
        for (int i = 0; i < COMMANDS; i++) {
            if (found != i && found != COMMANDS) continue;
            if (found != i) (void)fputs("\n", to);
            (void)fputs(command[i].help, to);
        }
        (void)fprintf(to, "\n%s", ending);
        return wants_help ? 0 : MK_EXIT_INPUT;
    }
    if (found < COMMANDS) return command[found].run(argc - 1, argv + 1);
    if (strcmp(name, "--version") == 0) {
        (void)puts("meshkal " MK_VERSION);
        return 0;
    }
    (void)fprintf(stderr, "meshkal: unknown command %s (meshkal help lists them)\n", name);
    return MK_EXIT_INPUT;
}

int main(int argc, char **argv) { return mk_finish(run(argc, argv)); }
