# SPDX-License-Identifier: MIT
"""The recording of a run that has no steps yet: what is known of it, as a text."""

import rerun as rr
import rerun.blueprint as rrb

from meshkal_log.fields import Header
from meshkal_log.scenario import Scenario
from ..summary.ending import ENDINGS


def blueprint() -> rrb.Blueprint:
    return rrb.Blueprint(rrb.TextDocumentView(origin="summary", name="Summary"), collapse_panels=True, auto_layout=False, auto_views=False)


def record(rec: rr.RecordingStream, header: Header, scenario: Scenario, run: int, end: str | None) -> None:
    state = "the run has only begun, or was cut" if end is None else ENDINGS[end]
    lines = [
        f"# {scenario.name}",
        f"**The log has no step of run {run}**: {state}.",
        f"{header.nodes} nodes, {header.estimators} estimators, filter `{header.filter}`, {header.steps} steps asked for. Open the log again when it has grown.",
    ]
    rec.send_recording_name(f"{scenario.name}: {header.filter}, run {run}")
    rec.log("summary", rr.TextDocument("\n\n".join(lines), media_type="text/markdown"), static=True)
