# SPDX-License-Identifier: MIT
"""The quantities of a batch that are drawn: one column an estimator, and what sums up the network. Numbers only, no rerun."""

import warnings
from collections.abc import Sequence

import numpy as np

from meshkal_log.fields import Batch, Header

# Over the nodes.
QUANTILES = {"median": 0.5, "low": 0.05, "high": 0.95}


def decibels(values: np.ndarray) -> np.ndarray:
    """20 log10 of `values`. What has no finite logarithm is NaN, which a plot shows as a gap; an infinity would blank the plot."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return finite(20.0 * np.log10(values))


def finite(values: np.ndarray) -> np.ndarray:
    values = np.asarray(values, dtype=np.float64)
    return np.where(np.isfinite(values), values, np.nan)


def root_mean_square(values: np.ndarray) -> np.ndarray:
    """Over the last axis, leaving NaN out. Scaled by the largest value, so that a diverging node cannot overflow the squares."""
    largest = quietly(np.nanmax, np.abs(values))
    scale = np.where(largest > 0, largest, 1.0)
    with np.errstate(invalid="ignore"):
        return scale * np.sqrt(quietly(np.nanmean, np.square(values / scale[..., None])))


def quietly(function, values: np.ndarray) -> np.ndarray:
    """A NaN-aware reduction over the last axis, where a row of nothing but NaN is NaN and no warning."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        return function(values, axis=-1)


def missing(arrived: np.ndarray, header: Header) -> np.ndarray:
    """How many slots of each estimator stayed empty: (T, slots) to (T, E)."""
    return np.add.reduceat((arrived == 0).astype(np.int64), header.slot_starts, axis=1)


def known_error(batch: Batch) -> np.ndarray | None:
    """The error, with NaN where no state has a truth: a norm over no states says nothing."""
    if batch.error is None:
        return None
    if batch.truth is None:
        return batch.error
    return np.where(np.isfinite(batch.truth).any(axis=1)[:, None], batch.error, np.nan)


def per_estimator(batch: Batch, header: Header) -> dict[str, np.ndarray]:
    """Arrays (T, E) by the name of the quantity."""
    with np.errstate(divide="ignore", invalid="ignore"):
        nis_ratio = batch.nis.astype(np.float64) / batch.nis_rows
    quantities = {
        "nis_ratio": finite(nis_ratio),
        "trace_covariance": finite(batch.trace_covariance),
    }
    for key in ("theta", "tolerance"):
        if getattr(batch, key) is not None:
            quantities[key] = finite(getattr(batch, key))
    # Of a tracking log, where a sensor need not have given a reading, they are counted in another way: tracking_numbers.py.
    if not header.tracking:
        quantities["missing_measurements"] = missing(batch.measurements_arrived, header)
        if batch.estimates_arrived is not None:
            quantities["missing_estimates"] = missing(batch.estimates_arrived, header)
    error = known_error(batch)
    if error is not None:
        quantities["error_db"] = decibels(error)
    return quantities


def network(batch: Batch, quantities: dict[str, np.ndarray]) -> dict[str, dict[str, np.ndarray]]:
    """Arrays (T,) by quantity and by the name of the summary."""
    summaries = {"nis_ratio": {"pooled": _pooled_nis(batch)} | spread(quantities["nis_ratio"])}
    for key in ("theta", "tolerance", "trace_covariance"):
        if key in quantities:
            summaries[key] = spread(quantities[key], most="largest")
    for key in ("missing_measurements", "missing_estimates"):
        if key in quantities:
            summaries[key] = {"total": quantities[key].sum(axis=1)}
    error = known_error(batch)
    if error is not None:
        each = spread(error, most="worst")
        summaries["error_db"] = {"rms": decibels(root_mean_square(error))} | {name: decibels(row) for name, row in each.items()}
    return summaries


def spread(values: np.ndarray, most: str = "") -> dict[str, np.ndarray]:
    """Median over the nodes and the ends of the band that holds 90 of 100; `most`: name of the largest, if wanted. NaN is left out."""
    wanted = QUANTILES | ({most: 1.0} if most else {})
    return dict(zip(wanted, quantiles(values, list(wanted.values()))))


def quantiles(values: np.ndarray, fractions: Sequence[float]) -> list[np.ndarray]:
    """Of each row, NaN left out, linear between neighbours, as numpy.nanquantile, which takes a hundred times as long where there is a NaN."""
    ordered = np.sort(values, axis=1)  # NaN last
    last = np.count_nonzero(~np.isnan(ordered), axis=1) - 1
    rows, out = np.arange(len(values)), []
    for fraction in fractions:
        at = fraction * np.maximum(last, 0)
        low = np.floor(at).astype(np.intp)
        below, above, part = ordered[rows, low], ordered[rows, np.minimum(low + 1, np.maximum(last, 0))], at - low
        # Infinities: where both are the same, their difference would be NaN.
        with np.errstate(invalid="ignore", over="ignore"):
            between = np.where(below == above, below, below + part * (above - below))
        out.append(np.where(part == 0.0, below, between))
    return out


def _pooled_nis(batch: Batch) -> np.ndarray:
    """All innovations of a step over all their degrees of freedom; an estimator whose statistic is not finite counts for neither."""
    nis = finite(batch.nis)
    rows = np.where(np.isnan(nis), 0, batch.nis_rows).sum(axis=1)
    return np.divide(np.nansum(nis, axis=1), rows, out=np.full(len(rows), np.nan), where=rows > 0)
