"""What the repair of a log set has done, a line for each kind."""

from __future__ import annotations

from collections.abc import Mapping

from hqpipe.logs.clocks import SAME_RATE, STEADY
from hqpipe.logs.repair.one_file import Repaired, Source
from hqpipe.logs.trajectory import AsRecorded, Repair


def describe(sources: Mapping[str, Source], repaired: Mapping[str, Repaired], dt: float) -> list[Repair]:
    """Missing samples, repeated rows, jitter and rates of a log set.

    Args:
        sources, repaired: file → before and after. dt: the sample time of the set, s.
    """
    found = [
        _repeated(sources),
        _missing(sources, repaired),
        _rates(sources, repaired, dt),
        _jitter(sources, repaired, dt),
    ]
    return [each for each in found if each]


def as_recorded(source: Source, found: Repaired) -> AsRecorded:
    """A file before its repair."""
    own = source.clock
    return AsRecorded(
        rows=source.rows,
        rate_hz=1.0 / own.dt,
        jitter_rms=own.jitter_rms,
        jitter_max=own.jitter_max,
        lost=int(own.lost.sum()),
        gaps=int((own.lost > 0).sum()),
        repeated=own.repeated,
        missing=sum(source.missing.values()) / (source.rows * len(source.table.columns)),
        stretches=len(found.stretches),
    )


def _repeated(sources: Mapping[str, Source]) -> Repair | None:
    files = [file for file, source in sources.items() if source.clock.repeated]
    count = sum(sources[file].clock.repeated for file in files)
    if not files:
        return None
    text = f"{count} row{'s' if count > 1 else ''} bear the time of the row before and were left out ({_where(files, sources)})"
    return Repair("repeated", text, tuple(files))


def _missing(sources: Mapping[str, Source], repaired: Mapping[str, Repaired]) -> Repair | None:
    files = [file for file, source in sources.items() if source.missing or source.clock.lost.any()]
    if not files:
        return None
    rows = sum(source.rows + int(source.clock.lost.sum()) for source in sources.values())
    skipped = sum(int(sources[file].clock.lost.sum()) for file in files)
    values = {name: sum(sources[f].missing.get(name, 0) for f in files) for f in files for name in sources[f].missing}
    what = []
    if skipped:
        what.append(f"{skipped} of {rows} rows ({skipped / rows:.2g} of all) are missing by the clock")
    if values:
        worst = max(values, key=lambda name: values[name])
        more = f" and {len(values) - 1} more column{'s' if len(values) > 2 else ''}" if len(values) > 1 else ""
        what.append(f"{sum(values.values())} values without sense in {worst}{more}")
    bridged = max(repaired[file].bridged for file in files)
    cut = [file for file in files if len(repaired[file].stretches) != 1]
    into = sum(len(repaired[file].stretches) for file in cut)
    text = f"{' and '.join(what)} ({_where(files, sources)}): they count for nothing, up to {bridged} in a row were bridged"
    if cut:
        text += f", at longer gaps {len(cut)} trial{'s were' if len(cut) > 1 else ' was'} cut into {into} stretches"
    share = sum(repaired[f].absent * sources[f].rows for f in files) / rows
    return Repair("missing", text, tuple(files), next(iter(values), ""), share)


def _rates(sources: Mapping[str, Source], repaired: Mapping[str, Repaired], dt: float) -> Repair | None:
    other = [
        f for f, source in sources.items() if abs(source.clock.dt / dt - 1.0) > SAME_RATE and repaired[f].resampled
    ]
    if not other:
        return None
    rates = sorted({f"{1.0 / sources[file].clock.dt:.4g}" for file in other}, key=float)
    shown = ", ".join(rates[:4]) + (", …" if len(rates) > 4 else "")
    text = (
        f"{_where(other, sources)} ran at {shown} Hz, most samples were recorded at {1.0 / dt:.4g} Hz: brought to that"
    )
    return Repair("rates", text, tuple(other))


def _jitter(sources: Mapping[str, Source], repaired: Mapping[str, Repaired], dt: float) -> Repair | None:
    files = [file for file, source in sources.items() if source.clock.jitter_rms > STEADY and repaired[file].resampled]
    if not files:
        return None
    rms, largest = (max(getattr(sources[f].clock, name) for f in files) for name in ("jitter_rms", "jitter_max"))
    text = (
        f"the clock jitters by up to {rms:.0%} of a sample (largest {largest:.0%}; {_where(files, sources)}): brought to a "
        f"uniform {1.0 / dt:.4g} Hz, measured signals interpolated, commands held"
    )
    return Repair("jitter", text, tuple(files), share=rms)


def _where(files: list[str], sources: Mapping[str, Source]) -> str:
    return files[0] if len(files) == 1 else f"{len(files)} of {len(sources)} trials"
