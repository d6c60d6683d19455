# SPDX-License-Identifier: MIT
"""Makes recordings of logs and reads them back as numbers."""

import io
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
from rerun.chunk import RrdReader

PACKAGE = Path(__file__).resolve().parents[2] / "tools" / "rerun"


class Recording:
    def __init__(self, path: Path) -> None:
        self.reader = RrdReader(path)

    def rows(self, entity: str, component: str, *, static: bool = False) -> tuple[np.ndarray, np.ndarray, list]:
        """Steps, sim_time (time_s of a tracking log) in nanoseconds, and one list of values a row, in order of time."""
        steps, times, values = [], [], []
        for chunk in self.reader.stream().filter(content=f"/{entity}", is_static=static, components=component):
            batch = chunk.to_record_batch()
            values += batch.column(component).to_pylist()
            if not static:
                steps += batch.column("step").to_pylist()
                seconds = "sim_time" if "sim_time" in batch.schema.names else "time_s"
                times += batch.column(seconds).cast("int64").to_pylist()
        order = np.argsort(steps, kind="stable") if steps else range(len(values))
        return np.array(steps, dtype=np.int64)[order] if steps else np.array([]), np.array(times)[order] if times else np.array([]), [
            values[i] for i in order
        ]

    def series(self, entity: str) -> np.ndarray:
        """Scalars over time: (T,) or (T, K)."""
        values = np.array(self.rows(entity, "Scalars:scalars")[2], dtype=np.float64)
        return values[:, 0] if values.ndim == 2 and values.shape[1] == 1 else values

    def entities(self) -> set[str]:
        return {chunk.entity_path.lstrip("/") for chunk in self.reader.stream()}

    def summary(self) -> str:
        (text,) = self.rows("summary", "TextDocument:text", static=True)[2]
        return text[0]


def convert(data: bytes, output: Path, run: int = 0) -> tuple[Recording, list[str]]:
    from meshkal_rerun import conversion

    done = conversion.convert({"log": io.BufferedReader(io.BytesIO(data))}, output, conversion.Wanted(run))
    return Recording(output), done.remarks


def command(*arguments, stdin: bytes | None = None, **environment: str) -> subprocess.CompletedProcess:
    env = {**os.environ, "PYTHONPATH": str(PACKAGE), **environment}
    return subprocess.run(
        [sys.executable, "-m", "meshkal_rerun", *map(str, arguments)], input=stdin, capture_output=True, env=env, timeout=120, check=False
    )
