"""Several files that make one trial: a recorder with a file per channel, or commands and measurements in two tables."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path

from hqpipe.logs.imports.mapping import PART, TRIAL
from hqpipe.logs.imports.recording import ImportLogError, Recording, Stream
from hqpipe.logs.imports.sources import Found, SourceFile, candidates, reader_of

_HOLE = re.compile(r"(\{part\}|\{trial\}|\*)")
_UNNAMED = "column0"  # the lone column of a table without a header
_LISTED = 4


@dataclass(frozen=True)
class JoinedFiles:
    """Reader of the files of one trial, each a stream named after its part.

    Attributes:
        parts: part → its file, in the order of their names.
    """

    parts: dict[str, SourceFile]
    suffixes: tuple[str, ...] = ()
    extra: str | None = None

    def read(self, path: Path) -> list[Recording]:
        """One recording of all parts; the lone column of a file without a header is named after its part.

        Raises:
            LogError: a part cannot be read. ImportLogError: it holds several recordings.
        """
        streams: list[Stream] = []
        notes: list[str] = []
        for part, file in self.parts.items():
            recordings = file.reader.read(file.path)
            if len(recordings) != 1:
                what = f"{file.path}: holds {len(recordings)} recordings, expected one in a file that 'join' takes"
                raise ImportLogError(what, file=file.path, field="join", fix="import such files without 'join'")
            streams += [_named(part, stream) for stream in recordings[0].streams]
            notes += [note for note in recordings[0].notes if note not in notes]
        return [Recording(path, tuple(streams), notes=tuple(notes))]


def _named(part: str, stream: Stream) -> Stream:
    """The stream under the name of its part; a lone column without a name gets that name too."""
    if stream.name:
        return replace(stream, name=f"{part}/{stream.name}")
    if list(stream.fields) != [_UNNAMED]:
        return replace(stream, name=part)
    return replace(stream, name=part, fields={part: stream.fields[_UNNAMED]})


def join_files(found: Found, pattern: str, map_path: Path) -> Found:
    """The files of `found`, and those in folders inside, as one source per trial.

    Args:
        found: what the sources hold. pattern: file names relative to any folder, with {part} and perhaps {trial}.
        map_path: the mapping file that states it, named in messages.

    Raises:
        ImportLogError: no file fits the pattern, or two stand for one part of a trial.
    """
    depth = pattern.count("/") + 1
    trials: dict[Path, dict[str, SourceFile]] = {}
    others: list[Path] = []
    seen = candidates(found.given, depth)
    for path in seen:
        parts = _matched(pattern, path, depth)
        reader = reader_of(path) if parts else None
        if parts and reader:
            trial, part = parts
            if other := trials.get(trial, {}).get(part):
                what = (
                    f"{path}: join: {pattern} takes it and {other.path.name} for the same part '{part}' of {trial.name}"
                )
                raise ImportLogError(
                    what, file=path, field="join", fix="tell them apart in the pattern, or move one away"
                )
            trials.setdefault(trial, {})[part] = SourceFile(path, reader)
        else:
            others.append(path)
    if not trials:
        named = ", ".join(str(path) for path in seen[:_LISTED]) or "none"
        what = f"{map_path}: no file fits join: {pattern} (found: {named})"
        raise ImportLogError(what, file=map_path, field="join", fix="write it for the end of these paths")
    files = [SourceFile(trial, JoinedFiles(dict(sorted(parts.items())))) for trial, parts in sorted(trials.items())]
    return Found(tuple(files), {}, (), (), found.given, tuple(others))


def _matched(pattern: str, path: Path, depth: int) -> tuple[Path, str] | None:
    """The trial that a file belongs to, as a path, and its part; None where it does not fit."""
    path = path.absolute()
    root, inside = path.parts[:-depth], path.parts[-depth:]
    expression = "".join(_expression(piece) for piece in _HOLE.split(pattern))
    if not root or not (match := re.fullmatch(expression, "/".join(inside))):
        return None
    levels = pattern.split("/")
    at = next(i for i, level in enumerate(levels) if PART in level)
    trial = next((i for i, level in enumerate(levels) if TRIAL in level), None)
    if trial is not None and trial < at:
        return Path(*root, *inside[: trial + 1]), match["part"]
    folder = Path(*root, *inside[:at])
    return folder if trial is None else folder / match["trial"], match["part"]


def _expression(piece: str) -> str:
    return {PART: "(?P<part>[^/]+?)", TRIAL: "(?P<trial>[^/]+?)", "*": "[^/]*?"}.get(piece, re.escape(piece))
