"""Fields of a recording with what their names say, and which of them are clocks."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hqpipe.logs.imports import guess_values as values_of
from hqpipe.logs.imports.clock import increasing
from hqpipe.logs.imports.guess_names import Meaning, meaning_of
from hqpipe.logs.imports.recording import Recording, Stream
from hqpipe.logs.imports.units import SAMPLES, UNITS


@dataclass(frozen=True, eq=False)
class NamedField:
    """A field with what its name says."""

    name: str
    stream: Stream
    short: str
    meaning: Meaning

    @property
    def values(self) -> np.ndarray:
        return self.stream.fields[self.short]

    @property
    def unit(self) -> str:
        """As the file or the name states it."""
        return self.stream.units.get(self.short, "") or self.meaning.unit


@dataclass
class Draft:
    """A drafted mapping.

    Attributes:
        content: of the mapping file. reasons: place, such as ("joints", "knee", "position") → why.
        unclear: what a person has to say before it can be used. left: fields that are not used → why.
    """

    content: dict[str, Any] = field(default_factory=dict)
    reasons: dict[tuple[str, ...], str] = field(default_factory=dict)
    unclear: list[str] = field(default_factory=list)
    left: dict[str, str] = field(default_factory=dict)


def fields_of(recording: Recording, draft: Draft) -> list[NamedField]:
    """The fields whose names mean something and that hold values; the others go to `draft.left`."""
    found = []
    several = len(recording.streams) > 1
    for stream in recording.streams:
        for short, values in stream.fields.items():
            name = f"{stream.name}/{short}" if several and stream.name else short
            meaning = meaning_of(short)
            if meaning is None:
                draft.left[name] = "its name says nothing"
            elif not np.isfinite(values).any():
                draft.left[name] = "it holds no value"
            else:
                found.append(NamedField(name, stream, short, meaning))
    return found


def clocks_of(recording: Recording, fields: list[NamedField], draft: Draft) -> dict[str, np.ndarray]:
    """Stream → its clock in s, and the entries `clock` and `clocks`."""
    entries: dict[str, dict[str, Any]] = {}
    found: dict[str, np.ndarray] = {}
    reasons: dict[str, str] = {}
    for stream in recording.streams:
        if stream.time is not None:
            found[stream.name] = stream.time
            continue
        named = [f for f in fields if f.stream is stream and f.meaning.channel == "clock"]
        names = [f.short for f in named if values_of.is_clock(f.values)]
        others = [
            n for n in stream.fields if n not in names and values_of.is_clock(stream.fields[n]) and _is_fine(stream, n)
        ]
        if not names and not others:
            what = f"which field{_of(stream)} is the clock? none increases from row to row"
            draft.unclear.append(f"{what}; if none was recorded, write clock: {{rate_hz: …}}")
            continue
        chosen = (names or others)[0]
        entry, reason, factor = _clock_entry(stream, chosen, next((f.unit for f in named if f.short == chosen), ""))
        reasons[stream.name] = reason if names else f"no field is named like a clock, this one increases; {reason}"
        if factor is None:
            draft.unclear.append(
                f"'{chosen}' counts samples: replace unit and rate_hz of the clock by those of the recorder"
            )
        entries[stream.name] = entry
        draft.left.pop(chosen, None)
        draft.left.pop(f"{stream.name}/{chosen}", None)
        found[stream.name] = stream.fields[chosen] * (factor or 1e-3)
        draft.left |= {f.name: f"a second clock beside '{chosen}'" for f in named if f.short != chosen}
    if len({str(entry) for entry in entries.values()}) == 1 and len(entries) == len(recording.streams):
        draft.content["clock"] = next(iter(entries.values()))
        draft.reasons[("clock",)] = next(iter(reasons.values()))
    elif entries:
        draft.content["clocks"] = entries
        draft.reasons |= {("clocks", name): reason for name, reason in reasons.items()}
    return found


def _of(stream: Stream) -> str:
    return f" of stream '{stream.name}'" if stream.name else ""


def _is_fine(stream: Stream, name: str) -> bool:
    """Whether a field without the name of a clock may be one: no signal of a joint that happens to rise."""
    meaning = meaning_of(name)
    return meaning is None and increasing(stream.fields[name])[0].mean() > 0.99


def _clock_entry(stream: Stream, name: str, stated: str) -> tuple[dict[str, Any], str, float | None]:
    """Entry, reason, and the factor to seconds; None for a clock that counts samples."""
    if stated in UNITS and UNITS[stated].kind == "time" and stated != SAMPLES:
        return {"field": name, "unit": stated}, "the unit is stated", UNITS[stated].factor
    guess = values_of.clock_unit(stream.fields[name])
    if guess is None:
        return (
            {"field": name, "unit": SAMPLES, "rate_hz": 1000},
            "CHECK: counts samples; the rate is not in the file",
            None,
        )
    return {"field": name, "unit": guess[0]}, guess[1], UNITS[guess[0]].factor
