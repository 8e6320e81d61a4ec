"""Reading the mapping file `hqpipe-log-map/1`."""

from __future__ import annotations

from collections.abc import Mapping as MappingType
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from hqpipe.errors import near_match
from hqpipe.files.documents import read_yaml_mapping
from hqpipe.files.entries import Entry
from hqpipe.logs.columns import CHANNELS as CHANNELS_OF_A_LOG_SET
from hqpipe.logs.columns import SHARED_UNITS, TIME, joint_column
from hqpipe.logs.drive import DRIVE, LOAD
from hqpipe.logs.imports.log_map import ClockSource, LogMap, Source, Term, TrialRule, sliding_by_units
from hqpipe.logs.imports.recording import ImportLogError
from hqpipe.logs.imports.units import COUNTS, KINDS, SAMPLES, UNITS, Unit, kinds_of
from hqpipe.logs.joint_kinds import KINDS as JOINT_KINDS
from hqpipe.logs.joint_kinds import PRISMATIC, REVOLUTE
from hqpipe.logs.manifest import CHOICES, COMMAND_OF, SPLITS

FORMAT = "hqpipe-log-map/1"
SKIP = "skip"
PART, TRIAL = "{part}", "{trial}"
"""In the pattern of `join`: what differs between the files of one trial, and between trials."""
_STATED = {"drive": DRIVE, "load": LOAD}
FIX = "correct the mapping file; docs/how-to/import-logs.md lists what it may hold"
CHANNELS = (
    "position",
    "velocity",
    "effort",
    "position_command",
    "effort_command",
    "valve_command",
    "current",
    "voltage",
    "duty",
    "temperature",
    "pressure_a",
    "pressure_b",
)
SHARED = (*SHARED_UNITS, "supply/voltage", "supply/current")
_MOST_COUNTS = 2.0**40  # counts per turn; encoders of 32 bits exist
_MOST = 1e12  # of scale, offset and zero; assumption: beyond it lies a slip of the hand
_MOST_FILES = 10_000  # patterns of `trials`


def read_map(path: Path) -> LogMap:
    """Read and check a mapping file.

    Raises:
        ImportLogError: names the field, what was found and what was expected.
    """
    return parse_map(read_yaml_mapping(path, FIX, ImportLogError), path)


def parse_map(content: dict[str, Any], path: Path) -> LogMap:
    """The same from plain data.

    Args:
        content: of the file. path: named in messages.
    """
    entry = Entry(content, path, FIX, kind=ImportLogError)
    optional = ("robot", *CHOICES, "rate_hz", "clock", "clocks", "shared", "trials", "drive", "load", "join")
    fields = entry.mapping(("format", "joints"), optional)
    if fields["format"].value != FORMAT:
        raise fields["format"].wrong(FORMAT)
    joints = fields["joints"].table()
    if not joints:
        raise fields["joints"].wrong("at least one joint")
    sources: dict[str, Source] = {}
    kinds: dict[str, str] = {}
    for name, joint in joints.items():
        channels, stated = _joint(name, joint)
        sources |= channels
        kinds |= {name: stated} if stated else {}
    _check_complete(fields["joints"], sources)
    if "control_mode" in fields:
        _check_mode(fields["control_mode"], sources)
    for name, source in fields["shared"].table().items() if "shared" in fields else ():
        _check_shared(name, source)
        sources[name] = _source(source, name)
    return LogMap(
        path=path,
        sources=sources,
        kinds=kinds,
        clock=_clock(fields["clock"]) if "clock" in fields else ClockSource(),
        clocks={n: _clock(c, False) for n, c in fields["clocks"].table().items()} if "clocks" in fields else {},
        trials=tuple(_rule(r, tuple(joints)) for r in fields["trials"].items(0, _MOST_FILES))
        if "trials" in fields
        else (),
        **{key: per_joint(fields[key], tuple(joints), known) for key, known in _STATED.items() if key in fields},
        join=_join(fields["join"]) if "join" in fields else None,
        robot=fields["robot"].text() if "robot" in fields else None,
        rate_hz=fields["rate_hz"].number(1e-3, 1e7, unit="Hz") if "rate_hz" in fields else None,
        **{key: fields[key].text(CHOICES[key]) for key in CHOICES if key in fields},
    )


def _joint(name: str, entry: Entry) -> tuple[dict[str, Source], str | None]:
    """The columns of a joint, and its type where that is stated."""
    if not name or "/" in name or name != name.strip() or not name.isprintable():
        raise entry.error(f"'{name}' is no name of a joint, expected letters, digits, '.', '-' or '_'")
    channels = entry.table()
    stated = channels.pop("type").text(JOINT_KINDS) if "type" in channels else None
    if not channels:
        raise entry.wrong(f"channels such as {', '.join(CHANNELS[:4])}")
    for channel, source in channels.items():
        if channel not in CHANNELS:
            hint = near_match(channel[:80], CHANNELS)
            raise source.error(f"unknown channel '{channel[:80]}'{hint}, expected one of {', '.join(CHANNELS)}")
    if "position" not in channels:
        raise entry.error(f"joint '{name}' has no position, expected one for every joint")
    found = {joint_column(name, c): _source(e, joint_column(name, c)) for c, e in channels.items()}
    said = sliding_by_units(found.values())
    if len(said) > 1:
        kinds = sorted({t.unit.kind for s in found.values() for t in s.terms if t.unit and t.scale is None})
        what = f"its units mix a joint that turns with one that slides ({', '.join(kinds)})"
        raise entry.error(what, "give all its channels angular or all of them linear units")
    if stated and said and said != {stated == PRISMATIC}:
        units = "linear" if stated == REVOLUTE else "angular"
        raise entry.error(
            f"its type is {stated}, its units are {units}",
            "correct the type or the units; where both are right, a scale",
        )
    return found, stated


def _check_complete(entry: Entry, sources: MappingType[str, Source]) -> None:
    """Refuse a channel that only some joints have, which no log set may hold."""
    joints = list(entry.table())
    for column in sources:
        _, joint, channel = column.split("/")
        lacking = [j for j in joints if joint_column(j, channel) not in sources]
        if lacking and channel in CHANNELS_OF_A_LOG_SET:
            what = f"joint '{joint}' has {channel}, joint '{lacking[0]}' has not; a log set has it for every joint or for none"
            raise entry.error(what, f"add {channel} to {', '.join(lacking)}, or drop it")


def _check_mode(entry: Entry, sources: MappingType[str, Source]) -> None:
    """Refuse a control mode whose command is not mapped, which no log set may state."""
    channel = COMMAND_OF.get(entry.text(CHOICES["control_mode"]))
    if channel and not any(column.endswith(f"/{channel}") for column in sources):
        what = f"{entry.value} control has {channel} as its input, which no joint has"
        raise entry.error(what, f"add {channel} to the joints, or leave control_mode out")


def _check_shared(name: str, entry: Entry) -> None:
    known = name in SHARED or name.split("/")[0] in ("foot", "servo", "other")
    if not known or name == TIME:
        hint = near_match(name[:80], SHARED)
        raise entry.error(f"unknown column '{name[:80]}'{hint}, expected one of {', '.join(SHARED)}, or other/<name>")


def _source(entry: Entry, column: str) -> Source:
    if isinstance(entry.value, str):
        return Source((Term((entry.text(),)),))
    if isinstance(entry.value, dict) and "sum" in entry.value:
        fields = entry.mapping(("sum",), ("offset",))
        terms = tuple(_term(item, column) for item in fields["sum"].items(1, 8))
        return Source(terms, fields["offset"].number(-_MOST, _MOST) if "offset" in fields else 0.0)
    if isinstance(entry.value, dict) and "integral" in entry.value:
        return _integral(entry, column)
    return Source((_term(entry, column),))


def _integral(entry: Entry, column: str) -> Source:
    """A position of which only the speed was recorded."""
    rest = dict(entry.value)
    if rest.pop("integral") is not True:
        raise entry.error("integral: expected true", "write integral: true, or leave it out")
    if not column.endswith("/position"):
        raise entry.error("integral belongs to a position, of which only the speed was recorded")
    return Source((_term(replace(entry, value=rest), speed_of(column)),), integral=True)


def speed_of(position: str) -> str:
    """The column of the velocity of a joint whose position's column is given."""
    return position.removesuffix("position") + "velocity"


def _term(entry: Entry, column: str) -> Term:
    if isinstance(entry.value, str):
        return Term((entry.text(),))
    fields = entry.mapping(("field",), ("unit", "counts_per_turn", "sign", "scale", "zero", "offset"))
    names = fields["field"]
    found = tuple(n.text() for n in names.items(1)) if isinstance(names.value, list) else (names.text(),)
    if not all(found):
        raise names.wrong("the name of a field")
    scale = fields["scale"].number(-_MOST, _MOST) if "scale" in fields else None
    if scale == 0.0:
        raise fields["scale"].wrong("a number other than 0")
    sign = fields["sign"].whole(-1, 1) if "sign" in fields else 1
    if sign == 0:
        raise fields["sign"].wrong("1 or -1")
    unit = _unit(fields, column, scale) if "unit" in fields else None
    rest = {key: fields[key].number(-_MOST, _MOST) for key in ("zero", "offset") if key in fields}
    return Term(found, unit, str(fields["unit"].value) if unit else "", float(sign), scale, **rest)


def _unit(fields: dict[str, Entry], column: str, scale: float | None) -> Unit:
    entry = fields["unit"]
    name = str(entry.value) if entry.value == 1 and not isinstance(entry.value, bool) else entry.text()
    unit = unit_named(name, entry)
    if name == SAMPLES:
        raise entry.error("samples are a unit of clocks only")
    if name == COUNTS:
        if "counts_per_turn" not in fields:
            raise entry.error("counts need counts_per_turn", "write counts_per_turn: 4096, or use scale")
        unit = Unit("angle", 2.0 * np.pi / fields["counts_per_turn"].number(1e-3, _MOST_COUNTS))
    elif "counts_per_turn" in fields:
        raise fields["counts_per_turn"].error("belongs to unit: counts")
    allowed = kinds_of(column)
    if allowed and unit.kind not in allowed and scale is None:
        expected = " or ".join(f"{kind} ({KINDS[kind]})" for kind in allowed)
        what = f"{name} is a unit of {unit.kind}, expected {expected} for {column}"
        raise entry.error(what, f"name another unit, or add scale: what one {KINDS[unit.kind]} is in {column}")
    return unit


def unit_named(name: str, entry: Entry) -> Unit:
    """The unit of that name.

    Raises:
        HqpipeError: of the entry, with the near match.
    """
    if name not in UNITS:
        folded = {each.casefold(): each for each in UNITS}
        meant = folded.get(name.casefold())
        hint = f" – did you mean '{meant}'?" if meant else near_match(name[:80], UNITS)
        raise entry.error(f"unknown unit '{name[:80]}'{hint}, expected one such as rad, deg, mm, N·m, bar, ms, A, V, %")
    return UNITS[name]


def _clock(entry: Entry, with_stream: bool = True) -> ClockSource:
    fields = entry.mapping((), ("field", "unit", "rate_hz", *(("stream",) if with_stream else ())))
    factor = None
    rows_hz = None
    if "rate_hz" in fields and not {"field", "unit"} & set(fields):
        rows_hz = fields.pop("rate_hz").number(1e-3, 1e7, unit="Hz")
    if "unit" in fields:
        unit = unit_named(fields["unit"].text(), fields["unit"])
        if unit.kind != "time":
            raise fields["unit"].wrong("a unit of time: s, ms, us, ns or samples")
        factor = unit.factor
        if fields["unit"].value == SAMPLES:
            if "rate_hz" not in fields:
                raise fields["unit"].error("samples need rate_hz", "write rate_hz: samples per second")
            factor = 1.0 / fields["rate_hz"].number(1e-3, 1e9, unit="Hz")
    if "rate_hz" in fields and (not factor or fields["unit"].value != SAMPLES):
        what = "belongs to unit: samples, or stands alone where no clock was recorded"
        raise fields["rate_hz"].error(what, "write the nominal rate at the top of the file")
    if factor is not None and "field" not in fields:
        raise entry.error("a unit belongs to a field", "name the field of the clock, or leave the unit out")
    text = {key: fields[key].text() for key in ("field", "stream") if key in fields}
    return ClockSource(text.get("field"), factor, text.get("stream"), rows_hz)


def _join(entry: Entry) -> str:
    pattern = entry.text()
    holes = [hole for hole in (PART, TRIAL) for _ in range(pattern.count(hole))]
    rest = pattern.replace(PART, "").replace(TRIAL, "")
    if holes not in ([PART], [PART, TRIAL]) or set("{}") & set(rest) or pattern.startswith("/") or ".." in rest:
        expected = f"file names with {PART} once and {TRIAL} at most once, such as '{TRIAL}_{PART}.csv' or '{TRIAL}/{PART}.csv'"
        raise entry.wrong(expected)
    return pattern


def _rule(entry: Entry, joints: tuple[str, ...]) -> TrialRule:
    fields = entry.mapping(("files",), ("split", "command", "base", "drive", "load"))
    files = fields["files"]
    return TrialRule(
        tuple(f.text() for f in files.items(1)) if isinstance(files.value, list) else (files.text(),),
        fields["split"].text((*SPLITS, SKIP)) if "split" in fields else None,
        {n: v.number(-_MOST, _MOST) for n, v in fields["command"].table().items()} if "command" in fields else None,
        fields["base"].text(CHOICES["base"]) if "base" in fields else None,
        **{key: per_joint(fields[key], joints, known) for key, known in _STATED.items() if key in fields},
    )


def per_joint(entry: Entry, joints: tuple[str, ...], known: MappingType[str, str]) -> dict[str, dict[str, float]]:
    """joint → quantity → value; a name that is no joint or none of the `known` quantities is an error."""
    found = {}
    for name, quantities in entry.table().items():
        if name not in joints:
            raise quantities.error(f"no joint '{name[:80]}'{near_match(name[:80], joints)}")
        stated = quantities.mapping((), tuple(known))
        found[name] = {quantity: value.number(0.0, _MOST, unit=known[quantity]) for quantity, value in stated.items()}
    return found
