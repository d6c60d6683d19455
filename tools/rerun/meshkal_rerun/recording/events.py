# SPDX-License-Identifier: MIT
"""When nodes went wrong, in words: an entity for each node that did, so that they can be read together or alone."""

import rerun as rr

from meshkal_log.fields import Header
from ..numbers.causes import Causes, episode_text
from ..numbers.departures import NETWORK, Departures, Episode, serious
from ..numbers.silence import silence_text
from .series import Clock

ORIGIN = "events"
# More would say that everything went wrong; the most serious ones are said.
MOST = 500


def path(header: Header, estimator: int) -> str:
    if estimator == NETWORK:
        return f"{ORIGIN}/network"
    return f"{ORIGIN}/centre" if header.central else f"{ORIGIN}/node/{header.estimator_nodes[estimator]}"


def name(names: list[str], estimator: int) -> str:
    return "network's median" if estimator == NETWORK else "the filter" if names == ["centre"] else names[estimator]


def send(rec: rr.RecordingStream, clock: Clock, header: Header, names: list[str], departures: Departures, causes: Causes) -> None:
    for entity, mine in entries_of(header, names, departures, causes).items():
        _, _, texts, levels = zip(*mine)
        rec.send_columns(entity, clock.instants([entry[:2] for entry in mine]), rr.TextLog.columns(text=texts, level=levels))


def entries_of(header: Header, names: list[str], departures: Departures, causes: Causes) -> dict[str, list[tuple[int, float, str, str]]]:
    """Step, second, text and level of each entry, in order of time, by entity."""
    entries: dict[str, list[tuple[int, float, str, str]]] = {}
    for episode in sorted(departures.episodes, key=serious, reverse=True)[:MOST]:
        who = name(names, episode.estimator)
        known = "; ".join(causes.texts.get(episode, []))
        said = episode_text(episode, who, departures.of_position)
        over = f"{who}: error as usual" if episode.of_error else ""  # the end of the others is in the entry of their begin
        _add(entries, path(header, episode.estimator), episode, said, f"; {known}" if known else "", over, "ERROR" if episode.of_error else "WARN")
    for silence, span in departures.silences[:MOST]:
        said = silence_text(silence, names[silence.estimator], header.central)
        _add(entries, path(header, silence.estimator), span, said, "", f"{names[silence.estimator]}: silence is over", "WARN")
    for mine in entries.values():
        mine.sort(key=lambda entry: entry[0])
    return entries


def _add(entries: dict, entity: str, span: Episode, said: str, known: str, over: str, level: str) -> None:
    mine = entries.setdefault(entity, [])
    mine.append((span.begin_step, span.begin_s, f"{said}, {'to the end' if span.lasts else f'until {span.end_s:.6g} s'}{known}", level))
    if over and not span.lasts:
        mine.append((span.end_step, span.end_s, over, "INFO"))
