"""The gap joint by joint, in each joint's own unit, as an HTML table."""

from __future__ import annotations

import html
from collections.abc import Mapping
from typing import Any

from hqpipe.report.diagnosis_words import number, percent_text


def joint_table(gap: Mapping[str, Any], causes: bool) -> str:
    """One row per joint; empty for a file that has no sizes of single joints.

    Args:
        gap: of diagnosis.json. causes: whether anything was found, so that there is an error after.
    """
    joints = gap.get("joints") or []
    if not joints:
        return ""
    columns = ["joint", "unit", "spread", "before", *(["after"] if causes else []), "noise floor", "persistence"]
    head = "".join(f'<th class="{"n" if i > 1 else ""}" scope="col">{name}</th>' for i, name in enumerate(columns))
    note = (
        "<p class=soft>No file says which joints turn and which slide: units are written as for joints that turn.</p>"
        if any(entry["type"] is None for entry in joints)
        else ""
    )
    rows = "".join(_row(entry, columns[3:]) for entry in joints)
    return (
        "<details><summary>Each joint in its own unit</summary>"
        f'<div class="scroll"><table class="plain"><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table></div>'
        f"{note}</details>"
    )


def _row(entry: Mapping[str, Any], names: list[str]) -> str:
    cells = "".join(f'<td class="n">{_size(entry, name.replace(" ", "_"))}</td>' for name in names)
    joint, unit = (html.escape(entry[name], quote=True) for name in ("joint", "unit"))
    return f'<tr><th scope="row">{joint}</th><td>{unit}</td><td class="n">{number(entry["scale"])}</td>{cells}</tr>'


def _size(entry: Mapping[str, Any], name: str) -> str:
    """A size in the joint's unit, and over its spread where it has one."""
    part = entry["normalised"][name]
    return number(entry[name]) + (f" ({percent_text(part)})" if part is not None else "")
