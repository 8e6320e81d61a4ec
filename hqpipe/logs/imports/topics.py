"""The messages of one topic, collected into columns."""

from __future__ import annotations

from array import array

import numpy as np

from hqpipe.logs.imports.arrays import listed
from hqpipe.logs.imports.messages import row_of

MOST_FIELDS = 4096  # of one topic; assumption: 35 motors of a humanoid with a dozen numbers each are 420
LARGEST_MESSAGE = 2**17  # bytes; assumption: the state of a humanoid takes 4 kB, one image or point cloud far more


class Topic:
    """Columns that grow with the messages; a field that a message lacks is NaN there.

    Args:
        name: of the topic.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self._columns: dict[str, array] = {}
        self._left_out: dict[str, str] = {}
        self._log = array("q")
        self._stamps: array | None = array("q")
        self._large = 0

    def __len__(self) -> int:
        return len(self._log)

    def add(self, message: object, log_time: int) -> None:
        """Take a decoded message.

        Args:
            message: as `hqpipe.logs.imports.messages` describes. log_time: ns, when it was written.
        """
        row, count = row_of(message), len(self._log)
        self._left_out |= row.left_out
        for name, value in row.numbers.items():
            column = self._columns.get(name)
            if column is None:
                if len(self._columns) == MOST_FIELDS:
                    self._left_out[name] = f"a topic may have {MOST_FIELDS} fields"
                    continue
                column = self._columns[name] = array("d", [np.nan]) * count
            column.append(value)
        if len(row.numbers) < len(self._columns):
            for column in self._columns.values():
                if len(column) == count:
                    column.append(np.nan)
        self._log.append(log_time)
        if row.stamp is None:
            self._stamps = None
        elif self._stamps is not None:
            self._stamps.append(row.stamp)

    def skip_large(self) -> None:
        """Count a message that was not decoded because of its size."""
        self._large += 1

    def log_times(self) -> np.ndarray:
        """(T,) ns, sorted."""
        return np.sort(np.frombuffer(self._log, np.int64))

    def stamps(self) -> np.ndarray | None:
        """(T,) ns as the sender stamped them, in the order of the log; None where a message has no stamp."""
        if self._stamps is None or not len(self._stamps):
            return None
        return np.frombuffer(self._stamps, np.int64)[self._order()]

    def fields(self) -> dict[str, np.ndarray]:
        """Field → (T,) float64 in the order of the log."""
        order = self._order()
        return {name: np.frombuffer(column, np.float64)[order] for name, column in self._columns.items()}

    def notes(self) -> list[str]:
        """What was left out, a line each."""
        by_reason: dict[str, list[str]] = {}
        for name, reason in self._left_out.items():
            if name not in self._columns:
                by_reason.setdefault(reason, []).append(name)
        found = [f"{self.name}: left out {listed(names)} ({reason})" for reason, names in by_reason.items()]
        if partial := [name for name in self._left_out if name in self._columns]:
            found.append(f"{self.name}: {listed(partial)} could not be read in every message")
        if self._large:
            found.append(
                f"{self.name}: {self._large} messages of more than {LARGEST_MESSAGE // 1024} KiB were not decoded"
            )
        return found

    def _order(self) -> np.ndarray:
        return np.argsort(np.frombuffer(self._log, np.int64), kind="stable")
