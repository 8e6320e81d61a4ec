"""The score of withheld-effect cases by family of machines, by effect, and beside answers that look at no logs."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from hqpipe.report.blind_parts import plain_table
from hqpipe.report.blind_table import share_text

if TYPE_CHECKING:
    from rich.table import Table

NAMES = {"diagnosis": "diagnosis", "null": "Null", "random": "Random"}
_UTILITY = (
    "m_utl is the utility of an answer to whoever repairs the machine (Feldman et al., Int. J. Prognostics and Health "
    "Management 1(2), 2010): 1 for the right set of effects, less for every false and every missed name, and the mean over all "
    "sets that the answer leaves open with <code>confused_with</code>."
)
Row = Sequence[str]


def group_sections(score: Mapping[str, Any]) -> str:
    """HTML of the three tables; empty for a score without them.

    Args:
        score: content of score.json.
    """
    if not score.get("families"):
        return ""
    null = (
        "Null names nothing and says <code>no_gap</code>; Random draws each effect of the library as often as the cases have "
        "one, whatever the logs say. A measure that they reach says nothing of a diagnosis."
    )
    effects = (
        "Named: with <code>confused_with</code>; of an effect outside the library, how often the answer admitted that there is "
        "one. Probability: the mean of what the true cause was given, 0 where it was not named. Falsely: cases in which the "
        "name stands for nothing that is there. Error: median of the parameters' relative errors."
    )
    parts = [
        "<h2>Beside answers that look at no logs</h2>",
        f'<p class="soft">{null} {_UTILITY}</p>',
        plain_table(*baseline_rows(score["baselines"]), numbers=(1, 2, 3)),
        "<h2>By family of machines</h2>",
        '<p class="soft">In brackets: strictly, without <code>confused_with</code>.</p>',
        plain_table(*family_rows(score["families"]), numbers=range(1, 1 + len(score["families"]))),
        "<h2>By effect</h2>",
        f'<p class="soft">{effects}</p>',
        plain_table(*effect_rows(score["effects"]), numbers=range(2, 10)),
    ]
    return "\n".join(parts)


def group_tables(score: Mapping[str, Any]) -> list[Table]:
    """The same three tables for the terminal; none for a score without them."""
    if not score.get("families"):
        return []
    found = {
        "Beside answers that look at no logs": baseline_rows(score["baselines"]),
        "By family of machines (strictly)": family_rows(score["families"]),
        "By effect": effect_rows(score["effects"]),
    }
    return [_table(title, *content) for title, content in found.items()]


def baseline_rows(baselines: Sequence[Mapping[str, Any]]) -> tuple[Row, list[Row]]:
    """Head and rows: a measure, and what the diagnosis, Null and Random reach."""
    head = ("measure", *(NAMES[entry["answers"]] for entry in baselines))
    return head, _measure_rows(baselines, _percent)


def family_rows(families: Sequence[Mapping[str, Any]]) -> tuple[Row, list[Row]]:
    """Head and rows: a measure, and what is reached on each family of machines."""
    head = ("measure", *(f"{entry['family']} ({entry['cases']} cases)" for entry in families))
    rows = _measure_rows(families, _with_strict)
    numbers = [entry["parameters"] for entry in families]
    rows.append(("effects that make no gap in their case", *(str(entry["hidden"]) for entry in families)))
    rows.append(("effects that make one and are not asked for", *(str(entry["not_asked"]) for entry in families)))
    rows.append(("parameters within 10 %", *(share_text(entry["close"]) for entry in numbers)))
    rows.append(("95 % intervals of the parameters cover", *(share_text(entry["covered"]) for entry in numbers)))
    rows.append(("median error of the parameters", *(_size(entry["median_error"]) for entry in numbers)))
    return head, rows


def effect_rows(effects: Sequence[Mapping[str, Any]]) -> tuple[Row, list[Row]]:
    """Head and rows: an effect of a family, and how it was answered."""
    head = ("family", "effect", "cases", "named", "strictly", "probability", "falsely")
    head += ("error", "within 10 %", "covered")
    rows = []
    for entry in effects:
        outside = " (outside the library)" if entry["outside"] else ""
        numbers = entry["parameters"]
        rows.append(
            (
                entry["family"],
                f"{entry['effect']}{outside}",
                str(entry["cases"]),
                _percent(entry["named"]),
                _percent(entry["strict"]),
                _number(entry["probability"]),
                str(entry["falsely"]),
                _size(numbers["median_error"]),
                _percent(numbers["close"]),
                _percent(numbers["covered"]),
            )
        )
    return head, rows


def _measure_rows(entries: Sequence[Mapping[str, Any]], text: Callable[[Mapping[str, Any]], str]) -> list[Row]:
    """One row for each measure that was tried anywhere, then mean probability and utility."""
    each = [entry["measures"] for entry in entries]
    rows: list[Row] = [
        (cells[0]["measure"], *(text(cell) for cell in cells))
        for cells in zip(*each, strict=True)
        if any(cell["of"] for cell in cells)
    ]
    rows.append(("mean probability of the true causes", *(_number(entry["probability"]) for entry in entries)))
    rows.append(("m_utl", *(_number(entry["utility"], 3) for entry in entries)))
    return rows


def _with_strict(row: Mapping[str, Any]) -> str:
    strict = "" if row["strict"]["right"] == row["right"] else f" [{row['strict']['right']}]"
    return f"{share_text(row)}{strict}"


def _percent(row: Mapping[str, Any]) -> str:
    return "–" if row["share"] is None else f"{100 * row['share']:.1f} % of {row['of']}"


def _size(error: float | None) -> str:
    return "–" if error is None else f"{100 * error:.1f} %"


def _number(value: float | None, digits: int = 2) -> str:
    return "–" if value is None else f"{value:.{digits}f}"


def _table(title: str, head: Row, rows: Iterable[Row]) -> Table:
    from rich.markup import escape
    from rich.table import Table

    table = Table(title=title, title_justify="left")
    for index, name in enumerate(head):
        table.add_column(name, justify="right" if index and name != "effect" else "left")
    for row in rows:
        table.add_row(*(escape(text) for text in row))
    return table
