# SPDX-License-Identifier: MIT
"""A run of meshkal simulate --filter duif as a C header for duif.c: readings, and what every node estimated. Usage: duif_data.py LOG HEADER"""
import pathlib
import sys

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).parents[1] / "host"))
import logs  # noqa: E402


def main(log: str, header: str) -> None:
    run, steps, end = logs.log(pathlib.Path(log).read_bytes())
    if run["filter"] != "duif" or end["end"] != "complete" or any((np.diff([run["start_s"]] + [s["time_s"][0] for s in steps]) != run["dt_s"])):
        sys.exit(f"duif_data: {log}: expected a complete run of duif with steps of {run['dt_s']} s, found {run['filter']}, end {end['end']}")
    suffix = "f" if run["real"] == "float32" else ""
    place = np.cumsum([0] + run["rows"][:-1])
    lines = [f"/* {len(steps)} steps of {run['nodes']} nodes. Made by duif_data.py. */", f"enum {{ STEPS = {len(steps)} }};",
             "typedef struct { uint8_t measures[NODES]; MK_REAL z[NODES], x[NODES * N]; } told_t;", "static const told_t told[STEPS] = {"]
    for step in steps:
        z = np.where(step["measuring"], step["measurements"][np.minimum(place, len(step["measurements"]) - 1)], 0).astype(run["real"])
        numbers = [", ".join(float(v).hex() + suffix for v in values) for values in (z, step["estimate"])]
        lines.append(f"    {{{{{', '.join(map(str, step['measuring']))}}}, {{{numbers[0]}}}, {{{numbers[1]}}}}},")
    pathlib.Path(header).write_text("\n".join([*lines, "};", ""]), encoding="ascii")


main(*sys.argv[1:])
