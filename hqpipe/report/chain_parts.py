"""What the report of a whole chain is made from: the results that were read, with their records, and one walk."""

from __future__ import annotations

import base64
import html
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hqpipe.errors import UsageError

_TYPES = {".png": "image/png", ".gif": "image/gif"}


@dataclass(frozen=True)
class Part:
    """One result of the chain.

    Attributes:
        artifact: its name, e.g. ``validation``.
        folder: with its files. shown: what the page calls it.
        command: that makes it, e.g. ``hqpipe validate``.
        record: its manifest as plain data; None for a folder from outside without one.
    """

    artifact: str
    folder: Path
    shown: str
    command: str
    record: Mapping[str, Any] | None

    def told(self, *keys: str) -> Any:
        """What the record says under metrics → keys.

        Raises:
            UsageError: it does not say that, as a record of an earlier version might not.
        """
        value: Any = {} if self.record is None else self.record["metrics"]
        for depth, key in enumerate(keys, start=1):
            if not isinstance(value, Mapping) or key not in value:
                name = ".".join(("metrics", *keys[:depth]))
                raise self.wrong(f"expected {name}", name)
            value = value[key]
        return value

    def wrong(self, problem: str, field: str | None = None) -> UsageError:
        """An error about the record of this result."""
        return UsageError(
            f"{self.folder}: manifest.json: {problem}",
            file=self.folder / "manifest.json",
            field=field,
            fix=f"make it again with `{self.command} --force`",
        )

    def parameter(self, name: str) -> Any:
        """A resolved parameter of the stage that made it; None where the record has none of that name."""
        return None if self.record is None else self.record["recipe"]["params"].get(name)


@dataclass(frozen=True)
class Walk:
    """The walk that the report shows.

    Attributes:
        robot: its name.
        film: GIF. figure: PNG with speed, feet, torques, pressure and posture.
        order: vx, vy (m/s), wz (rad/s; None where the heading is held).
        speed: mean forward speed once it walks steadily, m/s.
        seconds: length. fall_time: s, None if it did not fall.
        shown: s, first and last moment of the film. play: seconds of the walk in a second of film.
        seed: of sensor noise. plant: what is different on this plant, empty for nothing.
    """

    robot: str
    film: Path
    figure: Path
    order: tuple[float, float, float | None]
    speed: float
    seconds: float
    fall_time: float | None
    shown: tuple[float, float]
    play: float
    seed: int
    plant: Mapping[str, Any]


@dataclass(frozen=True)
class Chain:
    """Everything that the report shows.

    Attributes:
        walk: on film.
        parts: artifact → what was read of it; what is absent was not read.
        commands: artifact → the command that makes it, of every artifact that has a section.
        options: artifact → the option of `hqpipe report` that names a folder for it.
        gap: PNG of the diagnosis; None without one.
        notes: what a reader should know before the results are compared with one another.
    """

    walk: Walk
    parts: Mapping[str, Part]
    commands: Mapping[str, str]
    options: Mapping[str, str]
    gap: Path | None = None
    notes: Sequence[str] = ()


def text(value: Any) -> str:
    """Escaped for HTML."""
    return html.escape(str(value), quote=True)


def picture(path: Path, alt: str) -> str:
    """An image whose bytes stand in the page."""
    data = base64.b64encode(path.read_bytes()).decode("ascii")
    return f'<img src="data:{_TYPES[path.suffix]};base64,{data}" alt="{text(alt)}">'


def figure(part: Part, name: str, alt: str, caption: str) -> str:
    """A figure of a result; says so if the result does not hold it."""
    if not (part.folder / name).is_file():
        return (
            f'<p class="missing">{text(part.shown)} holds no <code>{text(name)}</code> ({text(alt)}): '
            f"<code>{text(part.command)}</code> writes it where there is something to draw.</p>"
        )
    return (
        f"<figure>{wide(part.folder / name, alt)}<figcaption>{text(caption)} "
        f"<span class=from>{text(part.shown)}/{text(name)}</span></figcaption></figure>"
    )


def wide(path: Path, alt: str) -> str:
    """A picture with small print, which a phone scrolls instead of shrinking it."""
    return f'<div class="wide">{picture(path, alt)}</div>'


def hidden(title: str, content: str) -> str:
    """HTML behind a line to open; nothing for nothing."""
    return f"<details><summary>{text(title)}</summary>{content}</details>" if content else ""


def table(head: Sequence[str], rows: Sequence[Sequence[str]], *, words: int = 1) -> str:
    """A table; cells are HTML. The first `words` columns are text, the others are numbers."""

    def row(cells: Sequence[str], tag: str) -> str:
        body = "".join(f"<{tag}{'' if i < words else ' class=n'}>{cell}</{tag}>" for i, cell in enumerate(cells))
        return f"<tr>{body}</tr>"

    body = "".join(row(cells, "td") for cells in rows)
    return f'<div class="scroll"><table><thead>{row(head, "th")}</thead><tbody>{body}</tbody></table></div>'


def plain(data: Any) -> str:
    """Plain data as indented JSON, escaped."""
    return f"<pre>{text(json.dumps(data, indent=1, ensure_ascii=False))}</pre>"
