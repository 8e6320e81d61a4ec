"""One recording and a mapping make one trial."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hqpipe.errors import near_match
from hqpipe.logs.columns import TIME, joint_column, joints_of
from hqpipe.logs.imports.align import is_held, lag_of_velocity, onto, overlap
from hqpipe.logs.imports.arrays import listed
from hqpipe.logs.imports.clock import MOST_DROPPED, increasing, regularity
from hqpipe.logs.imports.log_map import ClockSource, LogMap, Term
from hqpipe.logs.imports.mapping import FIX, speed_of
from hqpipe.logs.imports.recording import ImportLogError, Recording, Stream
from hqpipe.logs.imports.units import KINDS, UNITS, Unit, kinds_of, to_si
from hqpipe.logs.turns import encoder_range, in_words, jumps, nearest_turn

_LEAST_LAG = 0.5  # samples; a lag below is not worth a line
_NO_CLOCK = (
    "name its field in the mapping file: clock: {field: …, unit: …}; or clock: {rate_hz: …} if none was recorded"
)
_SI = {symbol: UNITS[symbol] for symbol in KINDS.values()}


@dataclass(frozen=True, eq=False)
class Converted:
    """A trial in SI units on one clock.

    Attributes:
        columns: full column name → (T,), NaN where a sample is missing; with `time`, s, from 0.
        clock_source: what the clock is, for the metadata of the file.
        notes: what was repaired, aligned or taken from the file, a line each.
    """

    columns: dict[str, np.ndarray]
    clock_source: str
    notes: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class _Clocked:
    """A stream with a clock that increases: (T,) s, and which rows of the stream it has; `name` is one of `owner`'s fields."""

    stream: Stream
    time: np.ndarray
    rows: np.ndarray
    name: str
    owner: str


def convert(recording: Recording, log_map: LogMap, *, strict: bool = False) -> Converted:
    """Take the mapped fields, in SI, on the clock of the effort's stream, else of the position's.

    Args:
        recording: as read. log_map: which field is which column.
        strict: refuse rows out of order and repeated time stamps instead of dropping them.

    Raises:
        ImportLogError: a field or clock is not there, has no value, or the clock is broken.
    """
    found = _find_all(recording, log_map)
    notes: list[str] = []
    clocks: dict[str, _Clocked] = {}
    for stream in {id(s): s for parts in found.values() for s, _ in parts}.values():
        clocks[stream.name] = _clocked(recording, stream, log_map, notes, strict)
    main = clocks[_main_stream(recording, log_map, found, clocks)]
    start, end = overlap([clocked.time for clocked in clocks.values()])
    common = (main.time >= start) & (main.time <= end)
    if common.sum() < 2:
        raise _wrong(recording, None, "its streams have no time in common", "record them together, or map one of them")
    clock = main.time[common]
    columns = {TIME: clock - clock[0]}
    for column, source in log_map.sources.items():
        total = np.full(len(clock), source.offset)
        for (stream, name), term in zip(found[column], source.terms, strict=True):
            measured = speed_of(column) if source.integral else column
            values = _in_si(recording, stream, name, term, measured)[clocks[stream.name].rows]
            total += _on_clock(clock, clocks[stream.name].time, values, column)
        if source.integral:
            total = _integral(clock, total)
            notes.append(f"{column} is the integral of '{found[column][0][1]}', from 0: its drift is not the machine's")
        columns[column] = _finite(recording, column, total, found[column])
    notes += _unwrap(recording, columns, log_map, strict)
    if len({clocked.owner for clocked in clocks.values()}) > 1:
        notes += _alignment(clocks, main, start, end)
    if len(clocks) > 1:
        notes += _row_by_row(clocks) + _lags(columns, found)
    notes += _assumed(log_map, found)
    return Converted(columns, main.name, tuple(notes))


def _integral(clock: np.ndarray, speed: np.ndarray) -> np.ndarray:
    """(T,) the integral of a speed by trapezoids, from 0; NaN where a sample is missing, over which it runs straight."""
    present = np.isfinite(speed)
    if present.sum() < 2:
        return np.full(len(speed), np.nan)
    whole = np.interp(clock, clock[present], speed[present])
    travelled = np.concatenate([[0.0], np.cumsum(0.5 * (whole[1:] + whole[:-1]) * np.diff(clock))])
    return np.where(present, travelled, np.nan)


def _unwrap(recording: Recording, columns: dict[str, np.ndarray], log_map: LogMap, strict: bool) -> list[str]:
    """Let positions that start again at the end of their encoder's range run on, and their commands with them."""
    notes = []
    for joint in joints_of(columns):
        position, velocity, command = (joint_column(joint, c) for c in ("position", "velocity", "position_command"))
        size = encoder_range(columns[TIME], columns[position], columns.get(velocity))
        if log_map.sliding(joint) or not size:
            continue
        what = f"{position} starts again after {in_words(size)}"
        if strict:
            raise _wrong(recording, position, what, "record it without, or import without --strict")
        columns[position] = columns[position] + size * jumps(columns[position], size)
        if command in columns:
            columns[command] = nearest_turn(columns[command], columns[position], size)
        notes.append(f"{what}: joined to one motion")
    return notes


def _on_clock(clock: np.ndarray, time: np.ndarray, values: np.ndarray, column: str) -> np.ndarray:
    """Values at the times of another clock: the samples themselves where they have its time stamps."""
    at = np.searchsorted(time, clock)
    if at[-1] < len(time) and np.array_equal(time[at], clock):
        return values[at]
    return onto(clock, time, values, held=is_held(column))


def _find_all(recording: Recording, log_map: LogMap) -> dict[str, list[tuple[Stream, str]]]:
    """Column → stream and name of the field of each of its terms: the first of the named ones that the recording has."""
    found: dict[str, list[tuple[Stream, str]]] = {}
    missing: list[tuple[str, ...]] = []
    for column, source in log_map.sources.items():
        for term in source.terms:
            places = [place for name in term.names if (place := _lookup(recording, name))]
            found.setdefault(column, []).extend(places[:1])
            missing += [] if places else [term.names]
    if missing:
        names = listed(list(dict.fromkeys(" or ".join(f"'{n}'" for n in each) for each in missing)))
        known = [f"{s.name}/{f}" if s.name else f for s in recording.streams for f in s.fields]
        what = f"no field {names}{near_match(missing[0][0], known) or f' (it has {listed(known)})'}"
        raise _wrong(recording, missing[0][0], what, "map it in a mapping file of its own, or leave the file out")
    return found


def _lookup(recording: Recording, name: str) -> tuple[Stream, str] | None:
    """A field named alone or as stream/field."""
    inside = [
        (s, name.removeprefix(f"{s.name}/")) for s in recording.streams if s.name and name.startswith(f"{s.name}/")
    ]
    for stream, field in sorted(inside, key=lambda pair: -len(pair[0].name)):
        if field in stream.fields:
            return stream, field
    having = [s for s in recording.streams if name in s.fields]
    if len(having) > 1:
        places = ", ".join(f"'{s.name}/{name}'" if s.name else f"'{name}'" for s in having[:4])
        raise _wrong(recording, name, f"the field '{name}' is in several streams ({places})", "name it as stream/field")
    return (having[0], name) if having else None


def _clocked(recording: Recording, stream: Stream, log_map: LogMap, notes: list[str], strict: bool) -> _Clocked:
    """The clock of a stream in seconds; rows that cannot be ordered are dropped."""
    time, name, owner = _time(recording, stream, log_map.clocks.get(stream.name, log_map.clock))
    rows, repeated, disordered = increasing(time)
    where = f"stream '{stream.name}': " if stream.name else ""
    if repeated or disordered:
        what = f"{where}{repeated} repeated time stamps, {disordered} rows out of order or without time, of {len(time)}"
        if strict:
            raise _wrong(recording, name, what, "sort the rows and drop duplicates, or import without --strict")
        if repeated + disordered > MOST_DROPPED * len(time):
            raise _wrong(recording, name, what, "name another field as the clock, or split the file")
        notes.append(f"{what}: dropped")
    if rows.sum() < 2:
        raise _wrong(recording, name, f"{where}fewer than 2 rows with a time stamp", "leave the file out")
    return _Clocked(stream, time[rows], rows, name, owner)


def _time(recording: Recording, stream: Stream, source: ClockSource) -> tuple[np.ndarray, str, str]:
    """(T,) s, what it was taken from, and the name of the stream that has it."""
    count = len(next(iter(stream.fields.values())))
    if source.rows_hz is not None:
        return np.arange(count) / source.rows_hz, f"rows at {source.rows_hz:g} Hz", stream.name
    if source.field is None:
        if stream.time is None:
            what = f"stream '{stream.name}' has no clock of its own" if stream.name else "no clock is named"
            raise _wrong(recording, "clock", what, _NO_CLOCK)
        return np.asarray(stream.time, np.float64), stream.time_name or "recorder", stream.name
    owner, field = _clock_of(recording, stream, source.field, count)
    stated = UNITS.get(owner.units.get(field, ""))
    factor = source.factor or (stated.factor if stated and stated.kind == "time" else 1.0)
    values = owner.fields[field][:count]
    present = np.flatnonzero(np.isfinite(values))
    origin = values[present[0]] if len(present) and len(recording.streams) == 1 else 0.0
    # the difference first: nanoseconds since 1970 have more digits than a float
    return (values - origin) * factor, field, owner.name


def _clock_of(recording: Recording, stream: Stream, name: str, count: int) -> tuple[Stream, str]:
    """The stream whose field is the clock of a stream of `count` rows, and the field.

    Files of one trial that have no clock go row by row with the one that has it; inputs may end a row earlier.
    """
    field = name.removeprefix(f"{stream.name}/") if stream.name else name
    if field in stream.fields:
        return stream, field
    other = _lookup(recording, name) if stream.time is None else None
    if other is None:
        where = f" in stream '{stream.name}'" if stream.name else ""
        what = f"no field '{name}'{where}, the clock{near_match(name, stream.fields)}"
        raise _wrong(recording, name, what, "name the clock of each stream under clocks:")
    rows = len(other[0].fields[other[1]])
    if not rows - 1 <= count <= rows:
        what = f"'{stream.name}' has {count} rows and no clock, '{name}' has {rows}: they cannot go row by row"
        raise _wrong(
            recording, name, what, f"state its clock: clocks: {{{stream.name}: {{rate_hz: …}}}}, or leave the file out"
        )
    return other


def _main_stream(
    recording: Recording, log_map: LogMap, found: dict[str, list[tuple[Stream, str]]], clocks: dict[str, _Clocked]
) -> str:
    """Name of the stream whose clock the trial keeps."""
    if wanted := log_map.clock.stream:
        if wanted not in clocks:
            what = f"no field of stream '{wanted}'{near_match(wanted, clocks)} is mapped, which clock.stream names"
            raise _wrong(recording, wanted, what, "name a stream that a channel comes from")
        return wanted
    joint = joints_of(found)[0]
    column = joint_column(joint, "effort")
    return found[column if column in found else joint_column(joint, "position")][0][0].name


def _in_si(recording: Recording, stream: Stream, name: str, term: Term, column: str) -> np.ndarray:
    """(T,) of one term in the unit of its column."""
    unit = term.unit or _stated(recording, stream, name, term, column) or Unit("", 1.0)
    values = to_si(stream.fields[name] - term.zero, unit)
    return term.sign * (1.0 if term.scale is None else term.scale) * values + term.offset


def _stated(recording: Recording, stream: Stream, name: str, term: Term, column: str) -> Unit | None:
    """The unit that the file states, if it is known and of the right kind; a scale in the mapping stands for itself."""
    unit = UNITS.get(stream.units.get(name, ""))
    if unit is None or term.scale is not None or not np.isfinite(unit.factor):
        return None
    allowed = kinds_of(column)
    if allowed and unit.kind not in allowed:
        what = (
            f"the file states '{stream.units[name]}' for field '{name}', expected {' or '.join(allowed)} for {column}"
        )
        raise _wrong(recording, name, what, "state its unit, and a scale, in the mapping file")
    return unit


def _finite(recording: Recording, column: str, values: np.ndarray, found: list[tuple[Stream, str]]) -> np.ndarray:
    """The values, NaN for those that no 32-bit float holds; refuses a column without any."""
    with np.errstate(over="ignore"):
        values = np.where(np.isfinite(values.astype(np.float32)), values, np.nan)
    if np.isnan(values).all():
        names = ", ".join(f"'{name}'" for _, name in found)
        raise _wrong(recording, found[0][1], f"no value in {names}, which is {column}", "leave the file out")
    return values


def _alignment(clocks: dict[str, _Clocked], main: _Clocked, start: float, end: float) -> list[str]:
    """How each stream ran, and what of it the trial has."""
    notes = [f"on the clock of stream '{main.owner}', {end - start:.1f} s in common"]
    for name, clocked in clocks.items():
        if clocked.owner != name:
            continue
        runs = regularity(clocked.time)
        gaps = f", {runs.gaps} gaps up to {runs.longest_s:.3g} s" if runs.gaps else ""
        lost = (clocked.time[-1] - clocked.time[0]) - (end - start)
        beyond = f", {lost:.1f} s outside of it" if lost > 1.0 / runs.rate_hz else ""
        notes.append(f"stream '{name}': {runs.rate_hz:.4g} Hz, jitter {runs.jitter:.1%}{gaps}{beyond}")
    return notes


def _row_by_row(clocks: dict[str, _Clocked]) -> list[str]:
    """Which streams have the clock of another one."""
    taken: dict[tuple[str, str], list[str]] = {}
    for name, clocked in clocks.items():
        if clocked.owner != name:
            taken.setdefault((clocked.owner, clocked.name), []).append(name)
    return [f"no clock in {listed(names)}: row by row with '{field}'" for (_, field), names in taken.items()]


def _lags(columns: dict[str, np.ndarray], found: dict[str, list[tuple[Stream, str]]]) -> list[str]:
    """Lags between streams that measure one quantity: velocities behind the derivatives of positions."""
    notes = []
    for joint in joints_of(columns):
        position, velocity = joint_column(joint, "position"), joint_column(joint, "velocity")
        if velocity not in columns or found[position][0][0] is found[velocity][0][0]:
            continue
        lag = lag_of_velocity(columns[TIME], columns[position], columns[velocity])
        if lag is not None and abs(lag) > _LEAST_LAG * np.median(np.diff(columns[TIME])):
            notes.append(f"{velocity} is {1e3 * lag:.1f} ms later than the derivative of the position (not corrected)")
    return notes


def _assumed(log_map: LogMap, found: dict[str, list[tuple[Stream, str]]]) -> list[str]:
    """Units that the mapping leaves to the file."""
    taken = {}
    for column, source in log_map.sources.items():
        for (stream, name), term in zip(found[column], source.terms, strict=True):
            if term.unit is None and term.scale is None:
                stated = stream.units.get(name, "")
                taken[name] = stated if stated in UNITS else f"SI (the file says '{stated}')" if stated else "SI"
    if not taken:
        return []
    groups: dict[str, list[str]] = {}
    for name, unit in taken.items():
        groups.setdefault(unit, []).append(name)
    return [
        "units that the mapping does not state: " + "; ".join(f"{u}: {', '.join(n[:4])}" for u, n in groups.items())
    ]


def _wrong(recording: Recording, field: str | None, what: str, fix: str = FIX) -> ImportLogError:
    name = f"{recording.path}: {recording.name}" if recording.name else f"{recording.path}"
    return ImportLogError(f"{name}: {what}", file=recording.path, field=field, fix=fix)
