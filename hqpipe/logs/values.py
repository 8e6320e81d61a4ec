"""Samples without physical sense: not finite, or larger than any sensor reads in any unit."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from hqpipe.errors import LogError
from hqpipe.logs.columns import TIME, unit_of

# unit → largest magnitude of a sample. Beyond SI on purpose: degrees, millimetres, counts or bar earn a warning, not a
# refusal. The squares of sums of such samples stay finite, so that no fit overflows on them.
_COUNTER = 1e10  # a 32-bit counter, read in its raw counts, ends at 4.3e9
LIMITS = {
    "s": 9.2e18,  # nanoseconds since 1970 are 1.8e18; a signed 64-bit clock ends at 9.22e18
    "rad": _COUNTER,
    "rad/s": 1e13,  # raw counts per sample of 1 ms, given per second
    "N·m": _COUNTER,  # 10 GN·m; in N·mm still a thousand times what hydraulics of a machine press
    "N": _COUNTER,
    "Pa": 1e12,  # 10,000 times the highest hydraulic pressure, 7e7 Pa
    "1": _COUNTER,
    "m": _COUNTER,
    "m/s": _COUNTER,
    "m/s²": _COUNTER,
    "°C": 1e6,
    "A": _COUNTER,
    "V": _COUNTER,
}
OTHER = 2e19  # a column whose unit is not known: an unsigned 64-bit number, a serial number or a clock, ends at 1.8e19


@dataclass(frozen=True)
class Senseless:
    """Samples of one column without physical sense.

    Attributes:
        row: the first one, counted from 0. value: its value. count: how many there are.
    """

    row: int
    value: float
    count: int

    def later(self, more: Senseless) -> Senseless:
        """These samples and `more` of later rows."""
        return replace(self, count=self.count + more.count)


def sound_samples(column: str, values: np.ndarray) -> np.ndarray:
    """(T,) whether each sample of a column is finite and has physical sense.

    Args:
        column: its full name, which says its unit. values: (T,) numbers.
    """
    limit = LIMITS.get(unit_of(column), OTHER)
    return np.abs(values.astype(np.float64, copy=False)) <= limit  # False for NaN too


def find_senseless(column: str, values: np.ndarray, first_row: int = 0) -> Senseless | None:
    """Look at the samples of a column.

    Args:
        column: its full name, which says its unit. values: (T,) numbers, or times. first_row: row of the first sample.
    """
    if values.dtype.kind not in "fiu":
        return None
    sound = sound_samples(column, values)
    if sound.all():
        return None
    row = int(np.argmin(sound))
    return Senseless(first_row + row, values[row], int((~sound).sum()))


def senseless_error(path: Path, column: str, found: Senseless) -> LogError:
    """What is said of a column with such samples."""
    limit = LIMITS.get(unit_of(column), OTHER)
    expected = f"at most {limit:g} in size" if np.isfinite(found.value) else "a finite number"
    needed = column == TIME or column.endswith("/position")
    return LogError(
        f"{path}: column '{column}', row {found.row}: {found.value:.6g} ({found.count} such "
        f"row{'s' if found.count > 1 else ''}), expected {expected}",
        file=path,
        field=column,
        fix="repair the rows or cut the trial there" + ("" if needed else ", or drop the column"),
    )
