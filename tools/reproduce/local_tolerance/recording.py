# SPDX-License-Identifier: MIT
"""The recording: the curves and the networks of one draw, the table of all."""

import hashlib
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from meshkal_rerun.recording import colours
from meshkal_rerun.recording.output import recording_file

from .draws import FILTERS, HORIZON, Draw
from .networks import mean_degree
from .properties import decibels
from .styles import ON_DARK

_ROBUST = ("rkfdu", "rkfdnu", "rkfdnu2")
_MAPPED = ("kfd", "rkfdu", "rkfdnu")
_NODE_RADIUS_M = 7.0
_STEPS = HORIZON + 1


def write(path: Path, draws: list[Draw], table: str) -> None:
    # Without it, rerun only warns about what it could not record.
    rr.set_strict_mode(True)
    draw = draws[0]
    low, high = _colour_range(draw)
    # The same numbers give the same id: the viewer merges recordings of equal id.
    identity = hashlib.sha256(table.encode()).hexdigest()[:16]
    with recording_file(path, f"local-tolerance-{identity}", _blueprint(draw, low, high)) as rec:
        rec.send_recording_name(f"Local tolerances: seed {draw.seed} of {len(draws)} draws")
        rec.log("table", rr.TextDocument(table, media_type="text/markdown"), static=True)
        for name in FILTERS:
            # Wide under narrow: both show where they agree.
            width = 5.0 if name == "rkfdnu" else 2.0
            _series(rec, draw, f"msd/{name}", decibels(draw.least_favourable[name].msd[:_STEPS]), name.upper(), _packed(ON_DARK[name]), width)
        transient = decibels(draw.least_favourable["rkfdnu2"].msd[:_STEPS]) - decibels(draw.least_favourable["rkfdnu"].msd[:_STEPS])
        _series(rec, draw, "transient", transient, "RKFDNU2 - RKFDNU", _packed(ON_DARK["rkfdnu2"]), 2.0)
        tones = colours.scale_colours(np.arange(len(draw.densities), dtype=float), 0.0, len(draw.densities) - 1.0)
        for tone, (density, (scenario, analysis)) in zip(tones[::-1], draw.densities.items()):
            label = f"RKFDNU, {mean_degree(scenario):.1f} neighbours"
            _series(rec, draw, f"density/{density}", decibels(analysis.msd[:_STEPS]), label, tone, 2.0)
        _series(rec, draw, "density/rkfc", decibels(draw.least_favourable["rkfc"].msd[:_STEPS]), "RKFC, hears all", _packed(ON_DARK["rkfc"]), 2.0)
        _nodes(rec, draw, "tolerance", draw.over_time["rkfdnu"].tolerance)
        constant = np.full(len(draw.over_time["rkfdu"].tolerance), draw.tolerance)
        _series(rec, draw, "tolerance/c", constant, "c", colours.REFERENCE, 2.0)
        for name in _ROBUST:
            _nodes(rec, draw, f"theta/{name}", draw.over_time[name].theta)
        for name in _MAPPED:
            _map(rec, draw, name, low, high)


def _packed(hexadecimal: str) -> int:
    return int(hexadecimal[1:], 16) << 8 | 0xFF


def _series(rec: rr.RecordingStream, draw: Draw, path: str, values: np.ndarray, name: str, colour: int, width: float) -> None:
    rec.log(path, rr.SeriesLines(names=name, colors=colour, widths=width), static=True)
    steps = np.arange(len(values))
    # Nanoseconds as integers: rerun truncates a column of float seconds.
    ns = np.rint(steps * (draw.scenario["model"]["dt_s"] * 1e9)).astype("timedelta64[ns]")
    times = [rr.TimeColumn("step", sequence=steps), rr.TimeColumn("sim_time", duration=ns)]
    rec.send_columns(path, times, rr.Scalars.columns(scalars=values))


def _nodes(rec: rr.RecordingStream, draw: Draw, path: str, values: np.ndarray) -> None:
    for k, colour in enumerate(colours.cycled(values.shape[1])):
        _series(rec, draw, f"{path}/node/{k}", values[:, k], f"node {k}", colour, 1.0)


def _colour_range(draw: Draw) -> tuple[float, float]:
    """One range for all maps, so that they compare."""
    values = decibels(np.concatenate([draw.least_favourable[name].node_msd for name in _MAPPED]))
    return float(values.min()), float(values.max())


def _map(rec: rr.RecordingStream, draw: Draw, name: str, low: float, high: float) -> None:
    # A 2D view has y downwards.
    place = np.array([node["position_m"][:2] for node in draw.scenario["nodes"]]) * (1.0, -1.0)
    values = decibels(draw.least_favourable[name].node_msd)
    edges = [place[list(edge)] for edge in draw.scenario["edges"]]
    rec.log(f"network/{name}/edges", rr.LineStrips2D(edges, colors=colours.LINK, radii=0.6), static=True)
    labels = [f"{k}: {value:.1f}" for k, value in enumerate(values)]
    points = rr.Points2D(place, radii=_NODE_RADIUS_M, colors=colours.scale_colours(values, low, high), labels=labels, show_labels=True)
    rec.log(f"network/{name}/nodes", points, static=True)


def _blueprint(draw: Draw, low: float, high: float) -> rrb.Blueprint:
    def plot(origin: str, name: str, *, legend: bool, contents: list[str] | None = None) -> rrb.TimeSeriesView:
        corner = rrb.PlotLegend(rrb.Corner2D.RightTop, visible=legend)
        return rrb.TimeSeriesView(origin=origin, name=name, contents=contents or ["$origin/**"], plot_legend=corner)

    def network(name: str) -> rrb.Spatial2DView:
        title = f"{name.upper()}: steady MSD at each node, dB, from {low:.1f} (blue) to {high:.1f} (red)"
        return rrb.Spatial2DView(origin=f"network/{name}", name=title)

    model = f"least favourable model, c = {draw.tolerance:g}"
    overview = rrb.Horizontal(
        rrb.Vertical(plot("msd", f"MSD of all states, dB ({model})", legend=True), plot("tolerance", "c_k(t) of every node, nats", legend=False)),
        rrb.Vertical(network("rkfdnu"), rrb.Tabs(*[plot(f"theta/{n}", f"theta_k(t), {n.upper()}", legend=False) for n in _ROBUST], active_tab=1)),
        column_shares=[1, 1],
        name="Overview",
    )
    more = rrb.Horizontal(
        rrb.Vertical(plot("density", "Three densities, MSD, dB", legend=True), plot("transient", "MSD of RKFDNU2 - RKFDNU, dB", legend=True)),
        rrb.Vertical(network("kfd"), network("rkfdu")),
        name="Densities, transient, other filters",
    )
    return rrb.Blueprint(
        rrb.Tabs(overview, more, rrb.TextDocumentView(origin="table", name="Table and properties of all draws"), active_tab=0),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline="step"),
        auto_layout=False,
        auto_views=False,
    )
