# SPDX-License-Identifier: MIT
"""When nodes went wrong, in words: an entity for each node that did, so that they can be read together or alone."""

import rerun as rr

from meshkal_log.fields import Header
from ..numbers.causes import Causes, episode_text
from ..numbers.departures import NETWORK, Departures, Episode
from .series import Clock

ORIGIN = "events"
# More would say that everything went wrong; the most serious ones are said.
MOST = 500


def path(header: Header, estimator: int) -> str:
    if estimator == NETWORK:
        return f"{ORIGIN}/network"
    return f"{ORIGIN}/centre" if header.central else f"{ORIGIN}/node/{header.estimator_nodes[estimator]}"


def name(names: list[str], estimator: int) -> str:
    return "network's median" if estimator == NETWORK else names[estimator]


def send(rec: rr.RecordingStream, clock: Clock, header: Header, names: list[str], departures: Departures, causes: Causes) -> None:
    worst = sorted(departures.episodes, key=lambda episode: (not episode.of_error, -episode.ratio))[:MOST]
    entries: dict[str, list[tuple[Episode, bool]]] = {}
    for episode in worst:
        mine = entries.setdefault(path(header, episode.estimator), [])
        mine.append((episode, True))
        if not episode.lasts:
            mine.append((episode, False))
    for entity, mine in entries.items():
        mine.sort(key=lambda entry: entry[0].begin_s if entry[1] else entry[0].end_s)
        texts, levels = [], []
        for episode, begins in mine:
            said = episode_text(episode, name(names, episode.estimator), departures.of_position)
            if begins:
                known = "; ".join(causes.texts.get(episode, []))
                until = "to the end" if episode.lasts else f"until {episode.end_s:.6g} s"
                texts.append(f"{said}, {until}" + (f"; {known}" if known else ""))
                levels.append("ERROR" if episode.of_error else "WARN")
            else:
                texts.append(f"{name(names, episode.estimator)}: {'error' if episode.of_error else 'test quantity'} as usual")
                levels.append("INFO")
        rec.send_columns(entity, clock.instants([(e.begin_step, e.begin_s) if begins else (e.end_step, e.end_s) for e, begins in mine]),
                         rr.TextLog.columns(text=texts, level=levels))
