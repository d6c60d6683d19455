# SPDX-License-Identifier: MIT
"""A network of emulated boards on links that lose, repeat, delay, damage and reorder frames. Every estimate is compared, bit for bit, with
the simulator's for the same arrivals, every message with that of the same node on the host. Exit status 0: all equal; 1: not; 2: wrong
arguments."""
import argparse
import json
import pathlib
import shlex
import signal
import subprocess
import sys
import time

import compare
import medium
from boards import Boards, Failure
from network import Network

ROOT = pathlib.Path(__file__).resolve().parents[3]
REBOOTED = 2
REJOIN = 4  # steps that a node which was reset may take to be back in step with the others
FAR = 3.0  # times the largest error of the others: as large may its own be then
HOST_LIMIT = 60.0  # seconds for a program on the host


def arguments():
    parser = argparse.ArgumentParser(prog="demo", description=__doc__)
    parser.add_argument("--build", type=pathlib.Path, required=True, help="folder of the images, the program and the host's nodes")
    parser.add_argument("--emulator", type=shlex.split, help="command that image and network are added to (default: in BUILD/demo/emulator)")
    parser.add_argument("--out", type=pathlib.Path, help="what is left behind (default: BUILD/demo, with --reboot BUILD/demo/reboot)")
    parser.add_argument("--steps", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1, help="of the air (default 1)")
    parser.add_argument("--reboot", action="store_true",
                        help="resets a node in the middle; from then on the boards are compared with the host's nodes only")
    parser.add_argument("--spoil", choices=("frame", "arrivals"),
                        help="changes a bit of a delivered estimate, or leaves out an arrival, which must be found")
    parser.add_argument("--limit", type=float, default=20.0, help="seconds to wait for any one message (default 20)")
    a = parser.parse_args()
    if a.steps < 8 or a.limit <= 0:
        parser.error("--steps must be 8 or more, --limit above 0")
    a.out = a.out or a.build / "demo" / ("reboot" if a.reboot else "")
    a.emulator = a.emulator or shlex.split((a.build / "demo" / "emulator").read_text())
    return a


def simulate(a, path, steps, *options):
    command = [a.build / "meshkal", "simulate", a.build / "demo" / "scenario.json", "--real", "float32", "--steps", str(steps), "--out", path]
    done = subprocess.run([*command, *options], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, timeout=HOST_LIMIT, text=True, check=False)
    if done.returncode:
        raise Failure(done.stderr.strip().removeprefix("meshkal: "))
    return compare.read_log(path)


def run_boards(a, neighbours, readings, reboot):
    air = medium.Medium(neighbours, a.seed)
    images = [a.build / "firmware" / "m4f" / f"demo-{k:02}-f32.elf" for k in range(len(neighbours))]
    shown = sys.stderr.isatty()

    def progress(position):
        if shown and position % 20 == 0:
            print(f"\rstep {position // 2}", end="", file=sys.stderr, flush=True)

    with Boards(a.emulator, images, a.out, a.limit, [REBOOTED] if reboot else []) as boards:
        network = Network(boards, air, readings, a.seed, reboot, a.spoil)
        network.run(progress)
    if shown:
        print("\r\033[K", end="", file=sys.stderr)
    names = compare.statuses(ROOT / "include" / "meshkal" / "base.h")
    return boards, air, [[(t, compare.Report(content, names)) for t, content in of_node] for of_node in network.reports]


def write_arrivals(a, path, arrivals):
    lines = sorted(arrivals)
    if a.spoil == "arrivals":
        lines.remove(next(line for line in lines if line[0] >= a.steps // 2))
    path.write_text("t,stage,from,to\n" + "".join("%d,%d,%d,%d\n" % line for line in lines))


def check_return(reports, at, truth, faults):
    """The node that was reset is soon in step with the others, stays so, and knows as much as they do in the end. The step in which it
    was back, or None."""
    after = [(t, report.step) for t, report in reports[REBOOTED] if t > at]
    back = next((t for t, step in after if step == t + 1), None)
    if back is None or back > at + REJOIN or any(step != t + 1 for t, step in after if t >= back):
        faults.append(f"node {REBOOTED}: not back in step within {REJOIN} steps after its reset in step {at}: (t, its step) {after[:8]}")
    errors = [compare.error(of_node[-len(after) // 2:-1], truth) for of_node in reports]
    worst = max(error for k, error in enumerate(errors) if k != REBOOTED)
    if not errors[REBOOTED] <= FAR * worst:
        faults.append(f"node {REBOOTED}: its error long after the reset is {errors[REBOOTED]:.3g}, that of the others at most {worst:.3g}")
    return back


def show(a, neighbours, air, reports, seconds, simulator, host, reboot):
    messages, lost = 2 * a.steps * sum(map(len, neighbours)), sum(count["lost"] for count in air.counts)
    print(f"{len(neighbours)} emulated Cortex-M4F boards, {a.steps} steps in {seconds:.1f} s; {lost / messages:.1%} of messages lost, "
          f"{1 - len(air.arrivals) / messages:.1%} missing in all\n")
    row = "{:>4}{:1} {:>5} {:>5} {:>5} {:>5} {:>5} {:>8} {:>7} {:>9} {:>7}  |{:>9} {:>6}  |{:>9} {:>6}".format
    print(f"{'':12}frames{'':54}|  simulator       |  node on the host")
    print(row("node", "", "hears", "sent", "taken", "early", "late", "repeated", "damaged", "strangers", "missing",
              "estimates", "equal", "messages", "equal"))
    for k, heard in enumerate(neighbours):
        r, count, marked = reports[k][-1][1], air.counts[k], "*" if reboot and k == REBOOTED else ""
        print(row(k, marked, len(heard), count["sent"], r.taken, r.early, r.late, r.repeated, r.damaged, r.stranger,
                  2 * a.steps * len(heard) - count["taken"], *simulator[k][:2], *host[k][:2]))
    print()


def demo(a):
    scenario = json.loads((a.build / "demo" / "scenario.json").read_text())
    nodes = range(len(scenario["nodes"]))
    neighbours = [sorted({i + j - k for i, j in scenario["edges"] if k in (i, j)}) for k in nodes]
    reboot = (REBOOTED, a.steps // 2) if a.reboot else None
    until = a.steps // 2 + 1 if a.reboot else a.steps  # the simulator knows no resets
    a.out.mkdir(parents=True, exist_ok=True)
    truth = simulate(a, a.out / "readings.cbor", a.steps)
    readings = compare.readings(truth)
    start = time.monotonic()
    boards, air, reports = run_boards(a, neighbours, readings, reboot)
    seconds = time.monotonic() - start
    write_arrivals(a, a.out / "arrivals.csv", air.arrivals)
    log = simulate(a, a.out / "run.cbor", until, "--arrivals", a.out / "arrivals.csv")

    faults = [] if compare.readings(log) == readings[:until] else ["the simulator drew other readings than the boards were given"]
    simulator = [compare.against_simulator(k, reports[k], log, until) for k in nodes]
    host = [compare.against_host(k, a.build / "demo" / "host" / f"node-{k:02}", boards.given[k], boards.sent[k], HOST_LIMIT) for k in nodes]
    for k in nodes:
        faults += [found for _, _, found in (simulator[k], host[k]) if found]
        if simulator[k][0] != until - 1:
            faults.append(f"node {k}: {simulator[k][0]} estimates to compare, not {until - 1}")
        if not reboot:
            faults += compare.against_air(k, reports[k][-1][1], air.counts[k])
    back = check_return(reports, reboot[1], truth, faults) if reboot else None

    show(a, neighbours, air, reports, seconds, simulator, host, reboot)
    if reboot:
        r = reports[REBOOTED][-1][1]
        print(f"* reset in step {reboot[1]}, {'not in step again' if back is None else f'in step again after step {back}'}: {r.caught_up} steps made "
              f"up for, {r.restarts} restarts; its counters are those since then.\nThe simulator knows no resets: it is compared, and the log ends, "
              "before that.")
    for fault in faults:
        print(f"DIFFERENT: {fault}")
    if not faults:
        print(f"All equal, bit for bit. Log: {a.out}/run.cbor   (.venv/bin/meshkal-rerun {a.out}/run.cbor makes a recording)")
    return 1 if faults else 0


def main():
    signal.signal(signal.SIGTERM, lambda number, frame: sys.exit(128 + number))
    try:
        return demo(arguments())
    except KeyboardInterrupt:
        return 130
    except (Failure, OSError, subprocess.TimeoutExpired) as error:
        print(f"demo: {error}", file=sys.stderr)
        return 1


sys.exit(main())
