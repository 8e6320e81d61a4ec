"""A diagnosis in the terminal: ten lines at most on 80 columns; rich is imported when they are made."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from hqpipe.report.diagnosis_words import (
    MARKS,
    confusions,
    joints_text,
    left_out_words,
    left_share,
    listed,
    number,
    parameter_name,
    parameter_text,
    percent,
    percent_text,
    reference_name,
    run_words,
    sizes,
    then_text,
    verdict_words,
    words,
)

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions, RenderableType, RenderResult
    from rich.text import Text

MAX_LINES = 10
_MAX_CAUSES = 5
_MAX_REASONS = 5  # warnings shown where they are the reason why nothing can be told
_LABEL = 8  # columns of the labels
_BAR = 12  # cells of a full bar
_EIGHTHS = " ▏▎▍▌▋▊▉"
# beside the word and the mark, so that nobody needs the colour
_COLORS = {"explained": "blue", "partly_explained": "cyan", "unknown": "yellow"}

Content = Mapping[str, Any]


def diagnosis_table(content: Content) -> RenderableType:
    """Verdict, gap, causes with a bar for each share, what remains, the next experiment and the warnings.

    The next experiment may take the lines that the others leave; every other line is cut at the terminal's width.
    diagnosis.json and diagnosis.html hold everything.

    Args:
        content: of diagnosis.json.
    """
    from rich.console import Group

    lines: list[RenderableType] = [_head(content)]
    if content["gap"] is not None:
        lines += _gap(content["gap"], len(content["causes"]))
        lines += _causes(content["causes"], content["logs"]["joints"], "changed" if "reference" in content else "cause")
        lines += _rest(content)
    lines += _without(content.get("left_out") or [])
    tail = _warnings(content["warnings"], 1 if content["gap"] is not None else _MAX_REASONS)
    room = MAX_LINES - len(lines) - len(tail)
    if room > 0 and (experiment := content["next_experiment"]):
        lines.append(_Line("next", experiment.replace("`", ""), room))
    return Group(*lines, *tail)


@dataclass(frozen=True)
class _Line:
    """A label and a text beside it, on so many lines at most; an ellipsis says that it goes on."""

    label: str
    text: str
    lines: int = 1

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        from rich.text import Text

        width = max(1, options.max_width - _LABEL)
        wrapped = Text(self.text).wrap(console, width)
        shown = wrapped[: self.lines]
        if len(wrapped) > self.lines:
            shown[-1].truncate(width - 1)
            shown[-1].append("…")
        for index, part in enumerate(shown):
            yield Text.assemble((f"{'' if index else self.label:<{_LABEL}}", "dim"), part)


def _head(content: Content) -> Text:
    from rich.text import Text

    verdict, gap = content["verdict"], content["gap"]
    head = Text.assemble((f"{MARKS[verdict]} {verdict_words(content)}", f"bold {_COLORS.get(verdict, 'default')}"))
    if since := reference_name(content):
        head.append(f" since {since}")
    if gap is not None:
        head.append(f"   {words(gap['layer'])}, held out, {run_words(gap, 0)} {1e3 * gap['window_s']:.0f} ms", "dim")
    return head


def _gap(gap: Content, causes: int) -> list[_Line]:
    """The sizes over the joints' spread, and in their unit where they have one and there is room."""
    size = {name: percent_text(value) for name, value in sizes(gap).items()}
    text = f"{size['before']} of spread"
    if causes:
        text = f"{size['before']} → {size['after']} of spread, {percent(gap['shrink'])} smaller"
    lines = [_Line("gap", f"{text}   noise floor {size['noise_floor']}   persistence {size['persistence']}")]
    if gap["unit"] is not None and causes < _MAX_CAUSES:
        text = " → ".join(number(gap[name]) for name in (("before", "after") if causes else ("before",)))
        floor, held = number(gap["noise_floor"]), number(gap["persistence"])
        lines.append(_Line("", f"{text} {gap['unit']}   noise floor {floor}   persistence {held}"))
    return lines


def _causes(causes: Sequence[Content], machine: Sequence[str], label: str) -> list[_Line]:
    """One line per cause: bar, share, effect, joints, first parameter, what shows it, what it could be confused with."""
    room = len(causes) if len(causes) <= _MAX_CAUSES else _MAX_CAUSES - 1
    lines = []
    for cause in causes[:room]:
        text = f"{bar(cause['shrink'])} {percent(cause['shrink']):>4}  {words(cause['effect'])}"
        text += f" · {joints_text(cause['joints'], machine)}"
        for name, parameter in list(cause["parameters"].items())[:1]:
            text += f" · {parameter_name(name)} {parameter_text(parameter)[0]}"
            text += f", {then}" if (then := then_text(parameter)) else ""
        if shown := cause.get("shown_by"):
            text += f" · {shown}"
        if other := confusions(cause):
            text += f" · or {listed(other, 'or')}"
        lines.append(_Line(label if not lines else "", text))
    if len(causes) > room:
        rest = sum(cause["shrink"] for cause in causes[room:])
        lines.append(_Line("", f"{bar(rest)} {percent(rest):>4}  {len(causes) - room} more causes"))
    return lines


def bar(share: float) -> str:
    """A bar of block characters, exact to an eighth of a cell; what is above zero is never empty.

    Args:
        share: 0…1; what lies outside is cut.
    """
    eighths = round(8 * _BAR * min(1.0, max(0.0, share)))
    if share > 0:
        eighths = max(1, eighths)
    full, part = divmod(eighths, 8)
    return ("█" * full + (_EIGHTHS[part] if part else "")).ljust(_BAR)


def _rest(content: Content) -> list[_Line]:
    """What is unexplained: where most of it is and what it depends on."""
    rest = content["unexplained"]
    if not rest["above_noise"] or rest["share_of_gap"] is None:
        return []
    text = f"{percent(left_share(content['gap']))} of the gap"
    if rest["where"]:
        place = rest["where"][0]
        regime = "" if place["regime"] == "all" else f" {words(place['regime'])}"
        text += f", most at {place['joint']}{regime}"
    if rest["depends_on"]:
        text += f", depends on {listed([words(item['signal']) for item in rest['depends_on'][:3]])}"
    return [_Line("unknown", text)]


def _without(left_out: Sequence[Content]) -> list[_Line]:
    """What of the logs was not used, and for which defect."""
    told = [f"{left_out_words(item)} ({words(item['kind'])})" for item in left_out]
    return [_Line("without", "; ".join(told))] if told else []


def _warnings(warnings: Sequence[str], most: int) -> list[_Line]:
    more = f"({len(warnings)} in all) " if len(warnings) > most else ""
    return [_Line("" if i else "warning", ("" if i else more) + text) for i, text in enumerate(warnings[:most])]
