# SPDX-License-Identifier: MIT
"""A run of meshkal simulate as a C header for network.c: what was measured, what arrived, what every node estimated. Usage: network_data.py LOG HEADER"""

import sys

import numpy as np
from meshkal_log.reader import LogReader


def main(log: str, header: str) -> None:
    with open(log, "rb") as stream:
        reader = LogReader(stream)
        (batch,) = reader.batches(0)
    run = reader.header
    if reader.end != "complete" or run.central:
        sys.exit(f"network_data: {log}: expected a complete run of a distributed filter, found {run.filter}, end {reader.end}")
    steps, nodes, states = batch.estimate.shape
    suffix = "f" if run.real == "float32" else ""
    arrived = {"have_measurement": batch.measurements_arrived, "have_estimate": batch.estimates_arrived}
    numbers = {
        "measurement": batch.measurements.astype(run.real),  # as a node converts its reading
        "estimate": batch.estimate.reshape(steps, nodes * states),
        "theta": batch.theta,
    }
    if not all(np.isfinite(values).all() for values in numbers.values()):
        sys.exit(f"network_data: {log}: some numbers are not finite")
    sizes = {"STEPS": steps, "NODES": nodes, "STATES": states, "ROWS": sum(run.rows), "SLOTS": sum(map(len, run.slots))}
    lines = [f"/* {steps} steps of {nodes} nodes, {run.filter}, loss {run.loss}, model {run.scenario_sha256}. Made by network_data.py. */"]
    lines.append(f"enum {{ {', '.join(f'{name} = {value}' for name, value in sizes.items())} }};")
    lines.append(f"static const uint8_t node_rows[NODES] = {{{', '.join(map(str, run.rows))}}};")
    for name, values in arrived.items():
        lines.append(f"static const uint8_t {name}[STEPS][SLOTS] = {{")
        lines += [f"    {{{', '.join(map(str, row.astype(int)))}}}," for row in values]
        lines.append("};")
    for name, values in numbers.items():
        lines.append(f"static const real_t {name}[STEPS][{values.shape[1]}] = {{")
        lines += [f"    {{{', '.join(float(value).hex() + suffix for value in row)}}}," for row in values]
        lines.append("};")
    with open(header, "w", encoding="ascii") as out:
        out.write("\n".join(lines) + "\n")


main(*sys.argv[1:])
