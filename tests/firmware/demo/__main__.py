# SPDX-License-Identifier: MIT
"""A network of emulated boards on links that lose, repeat, delay, damage and reorder frames. Every estimate is compared, bit for bit, with the simulator's for the
same arrivals, every message with that of the same node on the host. Exit status 0: all equal; 1: not; 2: wrong arguments."""
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
REJOIN = 4  # steps that a node which was reset may take to be back in step with the others
FAR = 3.0  # times the largest error of the others: as large may its own be then


def arguments():
    parser = argparse.ArgumentParser(prog="demo", description=__doc__)
    parser.add_argument("--build", type=pathlib.Path, required=True, help="folder of the images, the program and the host's nodes")
    parser.add_argument("--emulator", type=shlex.split, help="command that -kernel IMAGE and the network are added to (default: BUILD/demo/emulator)")
    parser.add_argument("--out", type=pathlib.Path, help="folder of what is left behind (default: BUILD/demo, with --reboot BUILD/demo/reboot)")
    parser.add_argument("--steps", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1, help="of the air (default 1)")
    parser.add_argument("--reboot", action="store_true", help="resets a node in the middle; what comes after is compared with the host's nodes only")
    parser.add_argument("--spoil", choices=("frame", "arrivals"), help="changes one bit of a delivered estimate, or leaves out one arrival: must be found")
    parser.add_argument("--limit", type=float, default=20.0, help="seconds to wait for any one message (default 20)")
    a = parser.parse_args()
    if a.steps < 8 or a.limit <= 0:
        parser.error("--steps must be 8 or more, --limit above 0")
    a.out = a.out or a.build / "demo" / ("reboot" if a.reboot else "")
    a.emulator = a.emulator or shlex.split((a.build / "demo" / "emulator").read_text())
    return a


def simulate(a, path, steps, *options):
    command = [a.build / "meshkal", "simulate", a.build / "demo" / "scenario.json", "--real", "float32", "--steps", str(steps), "--out", path, *options]
    done = subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, timeout=60, text=True, check=False)
    if done.returncode:
        raise Failure(done.stderr.strip().removeprefix("meshkal: "))
    return compare.read_log(path)


def run_boards(a, neighbours, given, reboot):
    air = medium.Medium(neighbours, a.seed)
    shown = sys.stderr.isatty()
    images = [a.build / "firmware" / "m4f" / f"demo-{k:02}-f32.elf" for k in range(len(neighbours))]
    with Boards(a.emulator, images, a.out, a.limit, reboot[:1] if reboot else ()) as boards:
        network = Network(boards, air, given, a.seed, reboot, a.spoil)
        network.run(lambda position: shown and position % 20 == 0 and print(f"\rstep {position // 2}", end="", file=sys.stderr))
    if shown:
        print("\r\033[K", end="", file=sys.stderr)
    return boards, air, network


def write_arrivals(a, path, arrivals):
    lines = sorted(arrivals)
    if a.spoil == "arrivals":
        lines.remove(next(line for line in lines if line[0] >= a.steps // 2))
    path.write_text("t,stage,from,to\n" + "".join("%d,%d,%d,%d\n" % line for line in lines))


def check_return(k, at, reports, log, faults):
    """The node that was reset is soon in step with the others, stays so, and knows as much as they do in the end."""
    after = [(t, report.step) for t, report in reports[k] if t > at]
    back = next((t for t, step in after if step == t + 1), None)
    if back is None or back > at + REJOIN or any(step != t + 1 for t, step in after if t >= back):
        faults.append(f"node {k}: not back in step within {REJOIN} steps after its reset in step {at}: (t, its step) {after[:8]}")
    errors = [compare.error(of_node[-len(after) // 2:-1], log) for of_node in reports]
    worst = max(error for other, error in enumerate(errors) if other != k)
    if not errors[k] <= FAR * worst:
        faults.append(f"node {k}: its error is {errors[k]:.3g} long after its reset, that of the others at most {worst:.3g}")
    return back


def table(a, neighbours, air, reports, simulator, host, reboot):
    print(f"{'node':>4} {'hears':>5} {'sent':>5} {'taken':>6} {'early':>5} {'late':>5} {'repeated':>8} {'damaged':>7} {'strangers':>9} {'missing':>7}"
          f" {'estimates':>10} {'equal':>6} {'messages':>9} {'equal':>6}")
    for k, heard in enumerate(neighbours):
        r, count = reports[k][-1][1], air.counts[k]
        missing = 2 * a.steps * len(heard) - count["taken"]
        marked = "*" if reboot and k == reboot[0] else " "
        print(f"{k:>3}{marked} {len(heard):>5} {count['sent']:>5} {r.taken:>6} {r.early:>5} {r.late:>5} {r.repeated:>8} {r.damaged:>7} {r.stranger:>9}"
              f" {missing:>7} {simulator[k][0]:>10} {simulator[k][1]:>6} {host[k][0]:>9} {host[k][1]:>6}")


def demo(a):
    scenario = json.loads((a.build / "demo" / "scenario.json").read_text())
    nodes = len(scenario["nodes"])
    neighbours = [sorted({i + j - k for i, j in scenario["edges"] if k in (i, j)}) for k in range(nodes)]
    reboot = (2, a.steps // 2) if a.reboot else None
    a.out.mkdir(parents=True, exist_ok=True)
    log = a.out / "run.cbor"
    truth = simulate(a, a.out / "readings.cbor", a.steps)
    given = compare.readings(truth)
    start = time.monotonic()
    boards, air, network = run_boards(a, neighbours, given, reboot)
    seconds = time.monotonic() - start
    write_arrivals(a, a.out / "arrivals.csv", air.arrivals)
    until = reboot[1] + 1 if reboot else a.steps
    simulated = simulate(a, log, until, "--arrivals", a.out / "arrivals.csv")

    faults = [] if compare.readings(simulated) == given[:until] else ["the simulator drew other readings than the boards were given"]
    names = compare.statuses(ROOT / "include" / "meshkal" / "base.h")
    reports = [[(t, compare.Report(content, names)) for t, content in of_node] for of_node in network.reports]
    simulator = [compare.against_simulator(k, reports[k], simulated, until) for k in range(nodes)]
    host = [compare.against_host(k, a.build / "demo" / "host" / f"node-{k:02}", boards.given[k], boards.sent[k], 60) for k in range(nodes)]
    for k in range(nodes):
        faults += [found for _, _, found in (simulator[k], host[k]) if found]
        if simulator[k][0] != until - 1:
            faults.append(f"node {k}: {simulator[k][0]} estimates to compare, not {until - 1}")
        if not reboot:
            faults += compare.against_air(k, reports[k][-1][1], air.counts[k])
    back = check_return(*reboot, reports, truth, faults) if reboot else None

    lost, messages = sum(c["lost"] for c in air.counts), 2 * a.steps * sum(map(len, neighbours))
    print(f"{nodes} emulated Cortex-M4F boards, {a.steps} steps in {seconds:.1f} s; {lost / messages:.1%} of messages lost, "
          f"{1 - len(air.arrivals) / messages:.1%} missing in all")
    print(f"{'':53}frames, by the node's own counters {'':>8} with the simulator  with the host's node")
    table(a, neighbours, air, reports, simulator, host, reboot)
    if reboot:
        r = reports[reboot[0]][-1][1]
        print(f"* reset in step {reboot[1]}, {'in step again after step ' + str(back) if back is not None else 'not in step again'}: {r.caught_up} steps made up for, "
              f"{r.restarts} restarts; its counters are those of its second life. The simulator knows no resets: it is compared, and the log ends, before.")
    for fault in faults:
        print(f"DIFFERENT: {fault}")
    if not faults:
        print(f"All equal, bit for bit. Log: {log}   (.venv/bin/meshkal-rerun {log} shows it)")
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
