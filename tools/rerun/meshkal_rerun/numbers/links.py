# SPDX-License-Identifier: MIT
"""Over which links nothing came. Numbers only, no rerun."""

import numpy as np

from meshkal_log.fields import Batch, Header


class Heard:
    """Links (M) that something should come over in each step: to a node the estimates of its neighbours, to a centre the readings of its sensors.
    `receiver` is header.nodes for a centre; `at` is the place in arrays over slots."""

    def __init__(self, header: Header) -> None:
        self._central, self._tracking = header.central, header.tracking
        receivers = [header.nodes] if header.central else header.estimator_nodes
        heard = [(int(first) + l, sender, receiver) for first, receiver, slots in zip(header.slot_starts, receivers, header.slots)
                 for l, sender in enumerate(slots) if sender != receiver and not (header.central and header.rows[sender] == 0)]
        self.at, self.sender, self.receiver = np.array(heard, dtype=np.intp).reshape(-1, 3).T

    def missing(self, batch: Batch) -> np.ndarray:
        """(T, M): nothing came. Of a tracking log a sensor that gave no reading is not missed."""
        if not self._central:
            if batch.estimates_arrived is None:
                return np.zeros((len(batch.step), len(self.at)), dtype=bool)
            return batch.estimates_arrived[:, self.at] == 0
        silent = batch.measurements_arrived[:, self.at] == 0
        return silent & (batch.measuring[:, self.sender] != 0) if self._tracking else silent
