# SPDX-License-Identifier: MIT
"""The 3-D scene: truth and its trail, the estimates, ellipsoids for their uncertainty, the sensors and their links."""

from functools import partial

import numpy as np
import rerun as rr

from meshkal_log.fields import Batch, Header
from meshkal_log.scenario import Scenario, positions_of
from ..numbers.survey import DRAWN_NODES
from . import colours

TRAIL_STEPS = 60
# Of the whole path of a run that goes on.
_PATH_POINTS = 20000

ELLIPSOIDS = "scene/ellipsoids_3_sigma"
OTHERS = "scene/other_estimates"
# More labels would hide each other.
LABELLED_NODES = 40


class Scene:
    def __init__(
        self, rec: rr.RecordingStream, header: Header, scenario: Scenario, names: list[str], palette: colours.Palette
    ) -> None:
        self._rec = rec
        self._position_states = scenario.position_states
        self._path: list[np.ndarray] = []  # every known true position, for the whole path
        self._path_of = "truth"
        self._recent = np.zeros((0, 3), dtype=np.float32)  # the last of them, for the trail
        self._names, self._palette = names, palette
        self._everyone = np.arange(header.estimators)
        self._shown = self._others = self._everyone[:0]
        self._draw_sensors = partial(self._sensors, header, scenario, palette)
        self.style_again()

    def style_again(self) -> None:
        """Of many nodes those that are named are shown, and the others as small points: their ellipsoids would cover all."""
        palette = self._palette
        self._shown = palette.named_estimators if len(self._everyone) > DRAWN_NODES else self._everyone
        self._others = np.setdiff1d(self._everyone, self._shown)
        # Negative radii are sizes on the screen, which suit any scale of the scene.
        if len(self._others):
            self._style(OTHERS, rr.Points3D, colors=colours.OTHERS, radii=-1.2)
        names, painted = [self._names[e] for e in self._shown], palette.estimators[self._shown]
        radii = np.where(np.isin(self._shown, palette.named_estimators), np.float32(-5.0), np.float32(-3.0))
        self._style("scene/estimates", rr.Points3D, colors=painted, labels=names, show_labels=False, radii=radii)
        faint = colours.with_alpha(painted, 90)
        self._style(ELLIPSOIDS, rr.Ellipsoids3D, colors=faint, labels=names, show_labels=False, line_radii=-0.4)
        self._draw_sensors()

    def _sensors(self, header: Header, scenario: Scenario, palette: colours.Palette) -> None:
        positions = scenario.node_positions_m
        if positions is None:
            return
        labels = [str(k) for k in range(header.nodes)]
        few = header.nodes <= LABELLED_NODES
        # Of a centre all would have a colour.
        painted = np.full(header.nodes, colours.REFERENCE, dtype=np.uint32) if header.central else palette.nodes
        if not few:
            named = list(palette.named)
            self._rec.log(
                "scene/named_sensors",
                rr.Points3D(positions[named], colors=painted[named], radii=-4.0, labels=[labels[k] for k in named], show_labels=True),
                static=True,
            )
        sensors = rr.Points3D(positions, colors=painted, radii=-4.0 if few else -1.5, labels=labels, show_labels=few)
        self._rec.log("scene/sensors", sensors, static=True)
        if not header.central:
            links = sorted({(min(k, j), max(k, j)) for k, slots in zip(header.estimator_nodes, header.slots) for j in slots if j != k})
            if links:
                colour = colours.LINK if few else colours.FAINT_LINK
                self._rec.log("scene/links", rr.LineStrips3D(positions[np.array(links)], colors=colour, radii=-0.5), static=True)

    def batch(self, times: list, batch: Batch) -> None:
        count, shown = len(batch.step), len(self._shown)
        centers = positions_of(batch.estimate, self._position_states)
        if len(self._others):
            self._points(OTHERS, times, centers[:, self._others])
        centers = centers[:, self._shown]
        self._points("scene/estimates", times, centers)
        if batch.position_covariance is not None:
            half_sizes, quaternions = ellipsoids(batch.position_covariance[:, self._shown].reshape(count * shown, -1), 3.0)
            columns = rr.Ellipsoids3D.columns(centers=centers.reshape(-1, 3), half_sizes=half_sizes, quaternions=quaternions)
            self._rec.send_columns(ELLIPSOIDS, times, columns.partition(np.full(count, shown)))
        if batch.truth is not None:
            self._truth(times, positions_of(batch.truth, self._position_states))

    def _points(self, path: str, times: list, points: np.ndarray) -> None:
        """(T, K, 3)"""
        each = np.full(len(points), points.shape[1])
        self._rec.send_columns(path, times, rr.Points3D.columns(positions=points.reshape(-1, 3)).partition(each))

    def _truth(self, times: list, positions: np.ndarray) -> None:
        if not self._path:
            self._style("scene/truth", rr.Points3D, colors=colours.TRUTH, radii=-7.0)
            self._style("scene/truth_trail", rr.LineStrips3D, colors=colours.TRUTH, radii=-1.5)
        known = np.isfinite(positions).all(axis=1)
        # An empty row, not a missing one: otherwise the last known truth would stay in the picture.
        columns = rr.Points3D.columns(positions=positions[known]).partition(known.astype(np.int64))
        self._rec.send_columns("scene/truth", times, columns)
        self._recent = send_trail(self._rec, "scene/truth_trail", times, self._recent, positions)
        self._path.append(positions[known])

    def thin(self) -> None:
        """The path of a run that goes on does not fill the memory: of its older part every second point is left out, again and again."""
        self._path = thinned(self._path)

    def finish(self) -> None:
        if self._path:
            path = np.concatenate(self._path)
            self._rec.log(f"scene/{self._path_of}_path", rr.LineStrips3D([path], colors=colours.LINK, radii=-0.5), static=True)

    def _style(self, path: str, archetype: type, **fields: object) -> None:
        self._rec.log(path, archetype.from_fields(**fields), static=True)


def thinned(path: list[np.ndarray]) -> list[np.ndarray]:
    if not path:
        return path
    whole = np.concatenate(path)
    return [whole[::2] if len(whole) > _PATH_POINTS else whole]


def send_trail(rec: rr.RecordingStream, path: str, times: list, recent: np.ndarray, positions: np.ndarray) -> np.ndarray:
    """Lines through the last known positions before each step. `recent`: those before the first one; returned: those after the last."""
    known = np.isfinite(positions).all(axis=1)
    points = np.concatenate([recent, positions[known]])
    ends = len(recent) + np.cumsum(known)
    strips = [points[max(0, end - TRAIL_STEPS) : end] for end in ends]
    rec.send_columns(path, times, rr.LineStrips3D.columns(strips=strips))
    return points[-TRAIL_STEPS:]


def ellipsoids(packed: np.ndarray, sigmas: float) -> tuple[np.ndarray, np.ndarray]:
    """Half axes (M, 3) and orientations (M, 4: x, y, z, w) of covariances (M, 1, 3 or 6), lower triangles by rows. Coordinates that are
    missing have no extent."""
    size = {1: 1, 3: 2, 6: 3}[packed.shape[1]]
    matrices = np.zeros((len(packed), 3, 3))
    rows, columns = np.tril_indices(size)
    matrices[:, rows, columns] = matrices[:, columns, rows] = packed
    known = np.isfinite(matrices).all(axis=(1, 2))
    matrices[~known] = 0.0
    values, axes = np.linalg.eigh(matrices)
    # A rotation, not a reflection.
    axes[:, :, 0] *= np.sign(np.linalg.det(axes))[:, None]
    half = sigmas * np.sqrt(np.maximum(values, 0.0))
    half[~known] = np.nan
    return half.astype(np.float32), _quaternions(axes)


def _quaternions(r: np.ndarray) -> np.ndarray:
    """Unit quaternions (x, y, z, w) of rotation matrices (M, 3, 3). 4 q q' is linear in the matrix: its row with the largest
    diagonal element is the quaternion, scaled, without cancellation."""
    xx, yy, zz = r[:, 0, 0], r[:, 1, 1], r[:, 2, 2]
    products = np.empty((len(r), 4, 4))
    products[:, 0, 0], products[:, 1, 1] = 1 + xx - yy - zz, 1 - xx + yy - zz
    products[:, 2, 2], products[:, 3, 3] = 1 - xx - yy + zz, 1 + xx + yy + zz
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        products[:, i, j] = products[:, j, i] = r[:, i, j] + r[:, j, i]
        products[:, k, 3] = products[:, 3, k] = r[:, j, i] - r[:, i, j]
    largest = np.argmax(products[:, range(4), range(4)], axis=1)
    rows = products[np.arange(len(r)), largest]
    return (rows / np.linalg.norm(rows, axis=1, keepdims=True)).astype(np.float32)


def viewpoint(scenario: Scenario, batch: Batch) -> tuple[np.ndarray, np.ndarray]:
    """Eye and target that show the sensors and where the truth (else the estimates) goes: from above if all is in a plane."""
    states = batch.estimate.reshape(-1, batch.estimate.shape[-1]) if batch.truth is None else batch.truth
    points = positions_of(states, scenario.position_states).astype(np.float64)
    sensors = np.zeros((0, 3)) if scenario.node_positions_m is None else scenario.node_positions_m
    sensors = sensors[np.isfinite(sensors).all(axis=1)]
    if not scenario.sensors:
        points, sensors = np.concatenate([points, sensors]), sensors[:0]
    points = points[np.isfinite(points).all(axis=1)]
    if len(points) == 0:
        points = sensors if len(sensors) else np.zeros((1, 3))
    # Percentiles: what diverges must not push the rest out of sight. Of a tracking log all sensors are seen: they may be few beside the
    # instants, and the target may be near some of them only.
    low, high = np.percentile(points, [1, 99], axis=0)
    low, high = np.vstack([sensors, low]).min(axis=0), np.vstack([sensors, high]).max(axis=0)
    target = (low + high) / 2.0
    planar = high[2] - low[2] < 0.05 * (high - low).max()
    direction = np.array([0.0, -0.35, 1.0] if planar else [0.5, -0.9, 0.6])
    distance = max(float(np.linalg.norm(high - low)), 1e-3)
    return target + 1.25 * distance * direction / np.linalg.norm(direction), target
