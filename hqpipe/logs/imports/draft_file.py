"""A drafted mapping as a YAML file that a person corrects."""

from __future__ import annotations

import re
from typing import Any

import yaml

from hqpipe.logs.imports.guess_fields import Draft
from hqpipe.logs.imports.mapping import FORMAT

_HEAD = """\
# Drafted from {source}. The text after # says why; lines with CHECK most need a look.
# docs/how-to/import-logs.md lists what a mapping file may hold.
"""
_ORDER = ("robot", "base", "control_mode", "effort_source", "rate_hz", "clock", "clocks", "joints", "shared", "trials")
_HINTS = {
    "base": "# base: fixed                  # floating | fixed",
    "effort_source": "# effort_source: pressure      # pressure | load_cell | current | estimate: where the effort is measured",
}
_UNPRINTABLE = re.compile(r"[^\x20-\x7e\u00a0-\uffff]")


def draft_text(draft: Draft, source: str) -> str:
    """The draft as YAML, with the reasons as comments.

    Args:
        draft: the mapping. source: file that it was drafted from.
    """
    lines = [_HEAD.format(source=_printable(source)) + f"format: {FORMAT}"]
    for key in _ORDER:
        if key in draft.content:
            lines += _section(draft, key, draft.content[key])
        elif key in _HINTS:
            lines.append(_HINTS[key])
    if draft.unclear:
        lines += [
            "",
            "# To be said by a person before this can be used:",
            *(f"#   {_printable(t)}" for t in draft.unclear),
        ]
    if draft.left:
        lines += ["", "# Fields that are not used:"]
        lines += [f"#   {_printable(name)}: {_printable(reason)}" for name, reason in draft.left.items()]
    return "\n".join(lines) + "\n"


def _section(draft: Draft, key: str, value: Any) -> list[str]:
    if key in ("joints", "clocks", "shared"):
        lines = [f"{key}:"]
        for name, inner in value.items():
            if key != "joints":
                lines.append(_line(2, name, inner, draft.reasons.get((key, name))))
                continue
            lines.append(f"  {_flow(name)}:")
            lines += [_line(4, c, entry, draft.reasons.get((key, name, c))) for c, entry in inner.items()]
        return lines
    return [_line(0, key, value, draft.reasons.get((key,)))]


def _line(indent: int, name: str, value: Any, reason: str | None) -> str:
    comment = f"  # {_printable(reason)}" if reason else ""
    return f"{' ' * indent}{_flow(name)}: {_flow(value)}{comment}"


def _flow(value: Any) -> str:
    """A value on one line."""
    text = yaml.safe_dump(value, default_flow_style=True, allow_unicode=True, sort_keys=False, width=float("inf"))
    return text.removesuffix("\n").removesuffix("\n...").strip()


def _printable(text: str) -> str:
    """Text that stays within its comment."""
    return _UNPRINTABLE.sub(" ", text)
