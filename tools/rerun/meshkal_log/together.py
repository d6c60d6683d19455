# SPDX-License-Identifier: MIT
"""What several logs are to each other: parts of one log of a network, which are joined, or logs of the same network, which are compared."""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from .fields import LINEAR, Header
from .joined import SAME
from .reader import LogError, LogReader

# What two logs must have in common, or their numbers cannot stand side by side.
_COMPARABLE = {"states": "number of states", "positions": "number of position states", "nodes": "number of nodes", "dt_s": "dt_s"}
# First and last step of each run of a log.
Spans = dict[int, tuple[int, int]]


def spans(name: str, reader: LogReader) -> Spans:
    """Reads the whole log, until it is damaged. Raises LogError if it begins so."""
    out: Spans = {}
    try:
        for run, batch in reader.numbered_batches():
            first, last = int(batch.step[0]), int(batch.step[-1])
            out[run] = (out[run][0], last) if run in out else (first, last)
    except LogError as error:
        raise LogError(f"{name}: {error}") from None
    return out


def groups(headers: dict[str, Header], spans_of: Callable[[str], Spans]) -> list[list[str]]:
    """Names of logs that are one log together, in the order of their first ones. Logs of nodes of one network are one, if no two of them are of the
    same node in the same step: a node that was started again has a second log. spans_of is asked for what several logs of one node hold."""
    out: list[list[str]] = []
    for name, header in headers.items():
        fitting = (group for group in out if all(_joined(headers, name, other, spans_of) for other in group))
        group = next(fitting, None)
        if group is None:
            out.append([name])
        else:
            group.append(name)
    return out


def _joined(headers: dict[str, Header], name: str, other: str, spans_of: Callable[[str], Spans]) -> bool:
    a, b = headers[name], headers[other]
    if _why_not_joined(a, b):
        return False
    if not set(a.estimator_nodes) & set(b.estimator_nodes):
        return True
    # The simulator writes a run into one log; only a running node goes on in another one.
    if a.source != "live":
        return False
    mine, theirs = spans_of(name), spans_of(other)
    return all(mine[run][1] < theirs[run][0] or theirs[run][1] < mine[run][0] for run in mine.keys() & theirs.keys())


def _why_not_joined(a: Header, b: Header) -> str:
    if a.kind != b.kind:
        return "its kind is another"
    if a.kind != LINEAR:
        return f"logs of {a.kind} scenarios are of all nodes"
    if a.central or b.central:
        return "one of them is the log of a centre"
    return next((f"its {key} is another" for key in SAME if getattr(a, key) != getattr(b, key)), "")


def check_comparable(first_name: str, first: Header, name: str, other: Header) -> None:
    """Raises LogError if the logs cannot be compared, and do not belong together otherwise."""
    if other.kind != first.kind:
        what = f"is not the log of a {first.kind} scenario, {first_name} is" if first.timed else f"is the log of a {other.kind} scenario, {first_name} is not"
        raise LogError(f"{name} {what}; they can be neither joined nor compared")
    if not (first.central or other.central) and not set(first.estimator_nodes) & set(other.estimator_nodes):
        raise LogError(f"{name} does not belong to {first_name}: {_why_not_joined(other, first)}, and they cannot be compared: they have no node in common")
    for key, what in _COMPARABLE.items():
        mine, theirs = getattr(first, key), getattr(other, key)
        if mine != theirs:
            raise LogError(f"{name} cannot be compared with {first_name}: its {what} is {theirs:g} instead of {mine:g}")


@dataclass(frozen=True)
class Label:
    key: str  # in names of entities
    text: str  # in titles and legends


_SHORT = {"loss": "loss {:g}", "real": "{}", "seed": "seed {}", "monitor": "monitor {}", "iterations": "{} iterations", "source": "{}"}


def labels(headers: Sequence[Header]) -> list[Label]:
    """By filter; of equal filters by what else differs, from each other if there are two, else from the first one; or by their places in the order."""
    filters = [header.filter for header in headers]
    keys = [f if filters.count(f) == 1 else f"{f}-{i + 1}" for i, f in enumerate(filters)]
    texts = list(filters)
    if len(set(filters)) < len(filters):
        basis = headers[::-1] if len(headers) == 2 else [headers[0]] * len(headers)
        texts = [" ".join([h.filter, *_apart(h, other)]) for h, other in zip(headers, basis)]
    return [Label(key, text if texts.count(text) == 1 else f"{text} ({i + 1})") for i, (key, text) in enumerate(zip(keys, texts))]


def _apart(header: Header, other: Header) -> list[str]:
    return [text.format(getattr(header, key) or (0 if key != "monitor" else "none")) for key, text in _SHORT.items()
            if getattr(header, key) != getattr(other, key)]


_FACTS = {
    "filter": "filter", "real": "arithmetic", "loss": "message loss", "seed": "seed", "source": "data", "runs": "runs", "steps": "steps asked for",
    "estimators": "estimators", "start_s": "start, s", "iterations": "iterations", "protocol": "protocol", "increments": "increments", "gate": "gate",
    "monitor": "monitor", "monitor_window": "monitor window", "monitor_false_alarm": "monitor false alarm", "program": "program",
}


def differing(headers: Sequence[Header]) -> list[tuple[str, list[str]]]:
    """What differs, and what each log has of it."""
    rows = [(name, [_text(getattr(header, key)) for header in headers]) for key, name in _FACTS.items()]
    rows.append(("scenario SHA-256", [header.scenario_sha256[:12] for header in headers]))
    rows.append(("nodes listened to", [f"{sum(map(len, header.slots))} slots" for header in headers]))
    rows = [(name, values) for name, values in rows if len(set(values)) > 1]
    parts = _scenario_parts(headers)
    return rows + ([("differs in the scenario", [", ".join(parts)] * len(headers))] if parts else [])


def _scenario_parts(headers: Sequence[Header]) -> list[str]:
    if len({header.scenario_sha256 for header in headers}) == 1:
        return []
    try:
        documents = [json.loads(header.scenario) for header in headers]
    except (ValueError, RecursionError):
        return []
    if not all(isinstance(document, dict) for document in documents):
        return []
    keys = dict.fromkeys(key for document in documents for key in document)
    return [str(key) for key in keys if any(document.get(key) != documents[0].get(key) for document in documents)]


def _text(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value) or "none"
