"""score.html: the score of a diagnosis on withheld-effect cases, one file that needs no network."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

from hqpipe.report.blind_groups import group_sections
from hqpipe.report.blind_limit import limit_section
from hqpipe.report.blind_parts import inline_svg, plain_table
from hqpipe.report.blind_table import interval_text, reached_text, share_text, title_text
from hqpipe.report.style import BLUE, FAINT, GREY, INK, VERMILION, new_figure, styled

_SIZES = ("small", "typical", "large")
_NEEDED = 0.9  # named nine times in ten: what the detection limit asks
_STYLE = """
body { margin: 0 auto; max-width: 1120px; padding: 20px 20px 60px; color: #222; background: #fff;
  font: 16px/1.5 system-ui, -apple-system, "Segoe UI", Roboto, sans-serif; }
h1 { font-size: 28px; margin: 8px 0; }
h2 { font-size: 20px; margin: 40px 0 6px; border-top: 1px solid #dcdcdc; padding-top: 14px; }
p { max-width: 92ch; margin: 6px 0 12px; } .soft { color: #555; font-size: 14px; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; font-size: 14px; font-variant-numeric: tabular-nums; }
th, td { text-align: left; padding: 5px 12px 5px 0; border-bottom: 1px solid #ececec; vertical-align: top; }
thead th { color: #555; font-weight: 600; } .n { text-align: right; white-space: nowrap; }
.yes { color: #0072B2; font-weight: 600; } .no { color: #B34700; font-weight: 600; }
.matrix th, .matrix td { padding: 1px 3px; border: 1px solid #efefef; font-weight: 400; }
.matrix td { text-align: center; min-width: 22px; } .matrix td.same { outline: 2px solid #222; outline-offset: -2px; }
.matrix thead th { height: 190px; vertical-align: bottom; padding: 0 0 4px; }
.matrix thead span { writing-mode: vertical-rl; transform: rotate(180deg); white-space: nowrap; }
.pair { display: flex; flex-wrap: wrap; gap: 24px; } .pair figure { margin: 0; flex: 1 1 440px; }
svg { width: 100%; height: auto; } figcaption { font-size: 14px; color: #555; }
"""


def write_page(path: Path, score: Mapping[str, Any]) -> Path:
    """Write the page.

    Args:
        path: file to write. score: content of score.json.
    """
    path = Path(path)
    path.write_text(page(score), encoding="utf-8")
    return path


def page(score: Mapping[str, Any]) -> str:
    """The whole page as text."""
    met = [row["met"] for row in score["aims"] if row["met"] is not None]
    title = f"Diagnosis on withheld effects: {title_text(score)}"
    parts = [
        f"<h1>{escape(title)}</h1>",
        f"<p>{sum(met)} of {len(met)} aims that could be judged are met. Shares with binomial 95 % intervals (Wilson). "
        "A name also counts if the diagnosis says that the logs cannot tell it from the true one; <i>strictly</i>, it "
        "does not.</p>",
        _aims(score["aims"]),
        "<h2>Without an aim</h2>",
        plain_table(
            ("measure", "reached", "95 % interval"),
            ((row["measure"], share_text(row), interval_text(row)) for row in score["more"] if row["of"]),
            numbers=(1, 2),
        ),
        group_sections(score),
        "<h2>Probabilities and detection</h2>",
        _figures(score),
        limit_section(score.get("limit")),
        "<h2>What was named first</h2>",
        '<p class="soft">Rows: the truth of the cases with one effect or none. Columns: the first cause. '
        "Framed: the same name.</p>",
        _matrix(score["confusion"]),
        "<h2>Claimed and true shrink</h2>",
        _shrinks(score["shrink"]),
        f"<h2>Misses: {len(score['misses'])}</h2>",
        _misses(score["misses"]),
    ]
    body = "\n".join(parts)
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>'
        f'<meta name="viewport" content="width=device-width, initial-scale=1"><style>{_STYLE}</style></head>'
        f"<body>\n{body}\n</body></html>\n"
    )


def _aims(rows: Sequence[Mapping[str, Any]]) -> str:
    words = {True: '<span class="yes">met</span>', False: '<span class="no">missed</span>', None: "–"}
    cells = []
    for row in rows:
        texts = (row["measure"], row["aim"], reached_text(row), interval_text(row), reached_text(row["strict"]))
        inner = "".join(f"<td{' class=n' if i else ''}>{escape(text)}</td>" for i, text in enumerate(texts))
        cells.append(f"<tr>{inner}<td>{words[row['met']]}</td></tr>")
    head = "".join(f"<th>{name}</th>" for name in ("measure", "aim", "reached", "95 % interval", "strictly", ""))
    return f'<div class="scroll"><table><thead><tr>{head}</tr></thead><tbody>{"".join(cells)}</tbody></table></div>'


def _figures(score: Mapping[str, Any]) -> str:
    calibration = score["calibration"]
    found = []
    if calibration["causes"]:
        text = (
            f"Reliability of {calibration['causes']} named causes: how often a cause of the stated probability was "
            f"right. Brier score {calibration['brier']:.3f} (0 is perfect, 0.25 is a coin)."
        )
        found.append((_draw_reliability(calibration["bins"]), text))
    if score["detection"]:
        text = "Share of single effects named, by size; all effects thick, each effect thin. Dotted: nine times in ten."
        found.append((_draw_detection(score["detection"]), text))
    if not found:
        return '<p class="soft">No cause was named, and no case has a single effect.</p>'
    return (
        '<div class="pair">' + "".join(f"<figure>{s}<figcaption>{t}</figcaption></figure>" for s, t in found) + "</div>"
    )


@styled
def _draw_reliability(bins: Sequence[Mapping[str, Any]]) -> str:
    """Observed share against stated probability with its interval."""
    figure = new_figure(4.0, 5.2)
    axes = figure.subplots()
    axes.plot([0, 1], [0, 1], color=GREY, linewidth=0.8, linestyle=":")
    for entry in bins:
        if not entry["of"]:
            continue
        x, y, (low, high) = entry["mean_probability"], entry["share"], entry["ci95"]
        axes.plot([x, x], [low, high], color=BLUE, linewidth=1.2)
        axes.plot([x], [y], "o", color=BLUE, markersize=5)
        axes.annotate(f"{entry['of']}", (x, y), (6, -4), textcoords="offset points", fontsize=8, color=INK)
    axes.set(xlim=(0, 1.03), ylim=(0, 1.03), xlabel="stated probability", ylabel="share that was right")
    return inline_svg(figure)


@styled
def _draw_detection(rows: Sequence[Mapping[str, Any]]) -> str:
    """Share named against size: one thin line per effect, the pooled one thick with its intervals."""
    figure = new_figure(4.0, 5.2)
    axes = figure.subplots()
    axes.axhline(_NEEDED, color=GREY, linewidth=0.8, linestyle=":")
    for effect in sorted({row["effect"] for row in rows} - {"any"}):
        line = [(_SIZES.index(row["size"]), row["share"]) for row in rows if row["effect"] == effect]
        axes.plot(*zip(*sorted(line), strict=True), color=FAINT, linewidth=0.9, marker=".", zorder=1)
    for row in (row for row in rows if row["effect"] == "any"):
        x = _SIZES.index(row["size"])
        axes.plot([x, x], row["ci95"], color=VERMILION, linewidth=1.2, zorder=3)
    pooled = sorted((_SIZES.index(row["size"]), row["share"]) for row in rows if row["effect"] == "any")
    axes.plot(*zip(*pooled, strict=True), color=VERMILION, linewidth=2.0, marker="o", zorder=3)
    axes.set(ylim=(0, 1.03), xlim=(-0.3, 2.3), xticks=range(3), xticklabels=_SIZES, ylabel="share named")
    return inline_svg(figure)


def _matrix(confusion: Mapping[str, Any]) -> str:
    head = "".join(f"<th><span>{escape(name)}</span></th>" for name in confusion["named"])
    rows = []
    for true, counts in zip(confusion["truth"], confusion["counts"], strict=True):
        total, cells = max(sum(counts), 1), []
        for name, count in zip(confusion["named"], counts, strict=True):
            shade = f"background: rgba(86, 180, 233, {count / total:.2f})"
            same = ' class="same"' if name == true else ""
            cells.append(f'<td{same} style="{shade}">{count or ""}</td>')
        rows.append(f"<tr><th>{escape(true)}</th>{''.join(cells)}</tr>")
    table = f'<table class="matrix"><thead><tr><th></th>{head}</tr></thead><tbody>{"".join(rows)}</tbody></table>'
    return f'<div class="scroll">{table}</div>'


def _shrinks(rows: Sequence[Mapping[str, Any]]) -> str:
    if not rows:
        return '<p class="soft">No case with the exact set of causes.</p>'
    outside = [row for row in rows if not row["covered"]]
    said = f"<p>{len(rows)} cases with the exact set of causes; in {len(outside)} the true shrink lies outside.</p>"
    texts = (
        (row["case"], f"{row['true']:.3f}", f"{row['claimed']:.3f}", f"{row['ci95'][0]:.3f} … {row['ci95'][1]:.3f}")
        for row in outside
    )
    return said + (plain_table(("case", "true", "claimed", "interval"), texts, (1, 2, 3)) if outside else "")


def _misses(rows: Sequence[Mapping[str, str]]) -> str:
    if not rows:
        return "<p>None.</p>"
    columns = ("case", "kind", "truth", "answer", "missed")
    return plain_table(columns, ([row[name] for name in columns] for row in rows))
