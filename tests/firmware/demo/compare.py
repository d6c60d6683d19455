# SPDX-License-Identifier: MIT
"""What the boards said, against the simulator's log, against the same nodes on the host, and against what the air did to their frames."""
import re
import struct
import subprocess

import cbor2
import numpy as np

from boards import NAMES, Failure

TYPES = {86: "<f8", 85: "<f4", 70: "<u4", 64: "u1"}  # RFC 8746
DAMAGED = ("LENGTH", "VERSION", "TYPE", "CHECKSUM", "SECURITY")


def typed(_, tag):
    return np.frombuffer(tag.value, TYPES[tag.tag]) if tag.tag in TYPES else tag


def read_log(path):
    """Header and step items of a complete log."""
    items = []
    with open(path, "rb") as file:
        try:
            while not items or "end" not in items[-1]:
                items.append(cbor2.load(file, tag_hook=typed))
        except (EOFError, cbor2.CBORDecodeError) as error:
            raise Failure(f"{path}: not a whole log: {error}") from None
    return items[0], items[1:-1]


def readings(log):
    """[t][k]: the reading of node k in step t as float32, as the simulator's nodes take it."""
    header, steps = log
    ends = np.cumsum(header["rows"])[:-1]
    return [[part.astype("<f4").tobytes() for part in np.split(item["measurements"], ends)] for item in steps]


class Report:
    """Content of a REPORT."""

    def __init__(self, content, statuses):
        numbers = len(statuses) + 5
        words = struct.unpack_from(f"<{numbers}I", content)
        self.step, counts = words[0], dict(zip(statuses, words[1:]))
        self.early, self.caught_up, self.restarts, self.unsent = words[numbers - 4:]
        self.taken, self.late, self.repeated, self.ahead = counts["OK"], counts["LATE"], counts["REPEATED"], counts["AHEAD"]
        self.stranger, self.damaged = counts["STRANGER"], sum(counts[name] for name in DAMAGED)
        self.others = sum(words[1:numbers - 4]) - self.taken - self.late - self.repeated - self.ahead - self.stranger - self.damaged
        self.estimate = content[4 * numbers:]


def statuses(header):
    """Names of mk_status_t in their order, from include/meshkal/base.h."""
    names = re.findall(r"^\s+MK_(OK|ERROR_\w+)\b", header.read_text(), re.MULTILINE)
    return [name.removeprefix("ERROR_") for name in names]


def against_simulator(k, reports, log, until):
    """(compared, equal, first difference or None) of the estimates of node k for the steps 1 .. until - 1."""
    header, steps = log
    compared = equal = 0
    first = None
    for t, report in reports:
        if t + 1 >= until:
            break
        wanted = steps[t + 1]["estimate"].reshape(header["nodes"], -1)[k].tobytes()
        compared += 1
        if report.step == t + 1 and report.estimate == wanted:
            equal += 1
        elif first is None:
            got, want = np.frombuffer(report.estimate, "<f4"), np.frombuffer(wanted, "<f4")
            first = f"node {k}, step {t + 1}: board {[float(x).hex() for x in got]}, simulator {[float(x).hex() for x in want]}"
    return compared, equal, first


def error(reports, log):
    """Root of the mean squared distance of these estimates from the truth."""
    steps = log[1]
    return float(np.sqrt(np.mean([np.sum((steps[t + 1]["truth"] - np.frombuffer(report.estimate, "<f4")) ** 2) for t, report in reports])))


def messages(data):
    found, at = [], 0
    while at + 4 <= len(data):
        end = at + 4 + struct.unpack_from("<H", data, at + 2)[0]
        found.append(data[at:end])
        at = end
    return found


def against_host(k, program, given, sent, limit):
    """(compared, equal, first difference or None) of the messages in all lives of board k: the same node on the host is given the same."""
    compared = equal = 0
    first = None
    for life, (inputs, outputs) in enumerate(zip(given, sent)):
        try:
            done = subprocess.run([program], input=b"".join(inputs), stdout=subprocess.PIPE, timeout=limit, check=False)
        except subprocess.TimeoutExpired:
            raise Failure(f"{program}: still running after {limit:g} s") from None
        if done.returncode:
            raise Failure(f"{program}: exit status {done.returncode}")
        wanted = messages(done.stdout)
        compared += max(len(outputs), len(wanted))
        equal += sum(a == b for a, b in zip(outputs, wanted))
        if first is None and outputs != wanted:
            i = next((i for i, (a, b) in enumerate(zip(outputs, wanted)) if a != b), min(len(outputs), len(wanted)))
            name = NAMES[(outputs + wanted)[i][0]] if i < len(outputs) else "nothing"
            first = f"node {k}, life {life}: message {i} of the board ({name}) is not that of the same node on the host"
    return compared, equal, first


def against_air(k, report, counts):
    """Differences between what the node counted and what the air did."""
    return [f"node {k}: counted {getattr(report, name)} frames {name}, the air delivered {counts[name]}"
            for name in ("taken", "early", "late", "repeated", "damaged", "stranger") if getattr(report, name) != counts[name]] + [
            f"node {k}: counted {number} frames {name}" for name, number in (("ahead", report.ahead), ("refused otherwise", report.others),
                                                                            ("that it could not send", report.unsent)) if number]
