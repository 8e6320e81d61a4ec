"""The sections of the diagnosis page as HTML; each escapes what comes from files, and is empty if it has nothing."""

from __future__ import annotations

import html
import re
from collections.abc import Mapping, Sequence
from typing import Any

from hqpipe.report.diagnosis_advice import Explained, explanation
from hqpipe.report.diagnosis_charts import has_after, rmse
from hqpipe.report.diagnosis_heat import heat_table
from hqpipe.report.diagnosis_joints import joint_table
from hqpipe.report.diagnosis_read import DiagnosisFiles, Trace
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
    size_text,
    sizes,
    then_text,
    verdict_sentence,
    verdict_words,
    words,
)

NO_BREAK = "\N{NO-BREAK SPACE}"
OPEN_TRACES = 12  # small multiples shown at once, a quadruped's joints; the others are in a list to open
OPEN_ROWS = 12  # rows of the effects considered shown at once
_CHIPS = 12  # joints that a card names one by one
_SCOPES = {"joint": "this joint only", "group": "a group of joints", "machine": "the whole machine"}
_SPREAD = (
    "Per cent are of each joint's spread, the standard deviation of its measured output over the fit trials, so that joints in "
    "different units count alike."
)
_FAMILY_NOTE = (
    "Rows are joints, columns are regimes. Shares are of the squared error above the noise floor; within a group of "
    "columns they add up to the whole. Framed: what the diagnosis names. Point at a cell for its numbers."
)

Content = Mapping[str, Any]


def verdict(content: Content) -> str:
    """Badge, sentence, the three numbers."""
    logs, mark = content["logs"], content["verdict"]
    many = len(logs["joints"])
    trials = f"{logs['trials']} trial{'s' if logs['trials'] != 1 else ''}"
    head = (
        f'<div class="top"><span class="badge {_text(mark)}">{MARKS[mark]} {_text(verdict_words(content))}</span>'
        f"<span>{_text(log_name(content))}{_since(content)} · {trials} · {many} joint{'s' if many != 1 else ''}</span></div>"
        f"<h1>{_text(verdict_sentence(content).replace(' N·m', NO_BREAK + 'N·m'))}</h1>"
    )
    gap = content["gap"]
    if gap is None:
        return head
    size, window = sizes(gap), f"{1e3 * gap['window_s']:.0f} ms"
    fall = f'<span class="before">{percent_text(size["before"])}</span>'
    note = "Root mean square on held-out trials"
    if content["causes"]:
        fall += f' → <span class="after">{percent_text(size["after"])}</span>'
        low, high = gap["shrink_ci95"]
        note = f"Smaller by {percent(gap['shrink'])} ({percent(low)} … {percent(high)}), on held-out trials"
    note += f"; {run_words(gap, 1)}"
    worse = size["before"] > size["persistence"]
    against = "the model before does not beat it" if worse else "a model should beat it"
    tiles = [
        ("gap before → after" if content["causes"] else "gap", fall, f"{note}."),
        ("noise floor", percent_text(size["noise_floor"]), "What a perfect model would still be off by."),
        ("persistence", percent_text(size["persistence"]), f"Error of holding the last value for {window}; {against}."),
    ]
    units = [" → ".join(number(gap[name]) for name in (("before", "after") if content["causes"] else ("before",)))]
    units += [number(gap[name]) for name in ("noise_floor", "persistence")]
    small = [f"{text} {_text(gap['unit'])}" if gap["unit"] is not None else "of the spread" for text in units]
    body = "".join(
        f"<div><dt>{name}</dt><dd>{value} <small>{unit}</small></dd><p>{text}</p></div>"
        for (name, value, text), unit in zip(tiles, small, strict=True)
    )
    return f'{head}<dl class="numbers">{body}</dl><p class="soft">{_SPREAD}</p>{_window(gap)}'


def _window(gap: Content) -> str:
    """Why the windows are as long as they are, where the diagnosis says so."""
    reason = gap.get("window_reason")
    return f'<p class="soft">Windows of {1e3 * gap["window_s"]:.0f} ms: {_text(reason)}.</p>' if reason else ""


def causes(content: Content, effects: Mapping[str, Explained]) -> str:
    """Waterfall, and a card for each cause."""
    if content["gap"] is None:
        return ""
    found = content["causes"]
    if found:
        text = "Each step is what one effect closes of the gap, with its 95% interval; together they lead to the gap after."
    elif content["verdict"] == "no_gap":
        text = "Nothing to explain: the error does not rise above the noise."
    else:
        text = "No effect was accepted."
        if content["effects_considered"]:
            text += " What was tried, and why it was not, is in the table further down."
    cards = "".join(_card(cause, content["logs"]["joints"], effects) for cause in found)
    title = f"Changed since {_text(reference_name(content))}" if "reference" in content else "Causes"
    return (
        f"<section><h2>{title}</h2><p>{text}</p>"
        '<div class="chart" data-figure="waterfall" role="img" aria-label="The gap before, by cause, and after"></div>'
        f'{_other_layers(content)}<div class="cards">{cards}</div></section>'
    )


def _card(cause: Content, machine: Sequence[str], effects: Mapping[str, Explained]) -> str:
    known = explanation(cause, effects)
    many = len(cause["joints"]) > _CHIPS or len(machine) > 1 and set(cause["joints"]) == set(machine)
    chips = [joints_text(cause["joints"], machine, _CHIPS)] if many else cause["joints"]
    table = "".join(_parameter_row(key, p) for key, p in cause["parameters"].items())
    other = confusions(cause)
    doubt = f"These logs cannot tell it from {listed(other, 'or')}." if other else ""
    return (
        f'<article class="card"><h3>{_text(words(cause["effect"]))}</h3>'
        f'<p class="soft">{_text(known.meaning)}</p>'
        f'<div class="chips">{"".join(f"<span class=chip>{_text(chip)}</span>" for chip in chips)}</div>'
        f"{_closes(cause)}<br>"
        f"probability <b>{percent(cause['probability'])}</b> · {_SCOPES.get(cause['scope'], _text(cause['scope']))}</p>"
        + (f'<div class="scroll"><table class="plain"><tbody>{table}</tbody></table></div>' if table else "")
        + _joint_by_joint(cause)
        + (f'<p class="but">{_text(doubt)}</p>' if doubt else "")
        + f'<p class="do">{_text(known.advice)}</p></article>'
    )


def _closes(cause: Content) -> str:
    """What a cause closes of the gap, or what shows it where no fit can; an open paragraph."""
    if shown := cause.get("shown_by"):
        return f"<p><b>{_text(shown)}</b>. No law of the torque predicts its course, so that it stays in what is unexplained."
    low, high = cause["shrink_ci95"]
    return (
        f'<div class="bar"><i style="width:{100 * min(1.0, max(0.0, cause["shrink"])):.1f}%"></i></div>'
        f"<p>closes <b>{percent(cause['shrink'])}</b> of the gap ({percent(low)} … {percent(high)})"
    )


def _parameter_row(key: str, parameter: Content) -> str:
    value, ci = map(_text, parameter_text(parameter))
    then = f'<td class="soft">{_text(then)}</td>' if (then := then_text(parameter)) else ""
    return f'<tr><th>{_text(parameter_name(key))}</th><td><b>{value}</b></td><td class="soft">{ci}</td>{then}</tr>'


def _joint_by_joint(cause: Content) -> str:
    """The numbers of each joint, where those of several were pooled."""
    rows = [
        f"<tr><th>{_text(joint)}</th><td>{_text(parameter_name(key))}</td><td>{_text(value)}</td>"
        f'<td class="soft">{_text(interval)}</td></tr>'
        for key, parameter in cause["parameters"].items()
        for joint, own in (parameter.get("joints") or {}).items()
        for value, interval in [parameter_text(parameter | own)]
    ]
    if not rows:
        return ""
    body = f'<div class="scroll"><table class="plain"><tbody>{"".join(rows)}</tbody></table></div>'
    return f"<details><summary>Joint by joint</summary>{body}</details>"


def _since(content: Content) -> str:
    """The earlier record that the logs were compared with."""
    since = reference_name(content)
    return f" compared with {_text(since)}" if since else ""


def _other_layers(content: Content) -> str:
    """The gaps of the layers that are not the largest one."""
    others = [gap for gap in content.get("gaps") or [] if gap["layer"] != content["gap"]["layer"]]
    rows = [
        f"<li>{_text(words(gap['layer']))}: {_text(size_text(gap, 'before'))} → {_text(size_text(gap, 'after'))}, "
        f"noise floor {_text(size_text(gap, 'noise_floor'))}</li>"
        for gap in others
    ]
    return f"<p>Other layers:</p><ul>{''.join(rows)}</ul>" if rows else ""


def where(files: DiagnosisFiles) -> str:
    """The most telling places, and joint × regime before and after."""
    content, gap = files.content, files.content["gap"]
    if gap is None or not (files.cells or content["where"]):
        return ""
    places = [f"<b>{_text(_place(p))}</b> {percent(p['share'])}" for p in content["where"][:4]]
    text = f"<p>Most telling: {'; '.join(places)}.</p>" if places else ""
    if not files.cells:
        lacking = "<p class=soft>There is no residuals.csv beside the diagnosis, so no table.</p>"
        return f"<section><h2>Where it is</h2>{text}{lacking}</section>"
    named = {(p["joint"], p["regime"]) for p in content["where"]}
    joints = content["logs"]["joints"]
    tables = [("Share of the gap, per cent", heat_table(files.cells, joints, named=named))]
    if content["causes"] and any(cell.share_after is not None for cell in files.cells):
        rest = content["unexplained"]
        later = {(p["joint"], p["regime"]) for p in rest["where"]}
        tables = [(f"Before: per cent of {_text(size_text(gap, 'before'))}", tables[0][1])]
        name = f"After: per cent of the {_text(size_text(gap, 'after'))} left"
        tables.append((name, heat_table(files.cells, joints, named=later, after=True)))
    body = "".join(f"<div><h3>{name}</h3>{table}</div>" for name, table in tables)
    return (
        f'<section><h2>Where it is</h2>{text}<div class="pair">{body}</div><p class="soft">{_FAMILY_NOTE}</p>'
        f"{joint_table(gap, bool(content['causes']))}</section>"
    )


def traces(files: DiagnosisFiles) -> str:
    """Small multiples: the worst window of each joint, the joints with most of the gap first."""
    if files.content["gap"] is None:
        return ""
    head = "<section><h2>Measured against the model</h2>"
    if not files.traces:
        return f"{head}<p class=soft>There is no traces.json beside the diagnosis, so nothing to draw.</p></section>"
    order = by_share(files)
    figures = [_trace(trace, index) for index, trace in order]
    both = any(has_after(trace) for trace in files.traces)
    keys = [("measured", "key", "#222"), ("model before" if both else "model", "key before", "")]
    keys += [("model with the causes", "key after", "")] if both else []
    names = {name for trace in files.traces for name in trace.series}
    keys += [("command", "key dot", "#222")] if "command" in names else []
    keys += [("position", "key", "#8A8A8A")] if "position" in names and _shows_position(files.traces) else []
    keys += [("restart from the log", "key thin", "")] if any(t.restarts for t in files.traces) else []
    legend = "".join(f'<span class="{c}"{f" style=color:{ink}" if ink else ""}>{n}</span>' for n, c, ink in keys)
    more = len(figures) - OPEN_TRACES
    rest = (
        f'<details><summary>{more} more joint{"s" if more > 1 else ""}</summary><div class="grid">' if more > 0 else ""
    )
    rest += "".join(figures[OPEN_TRACES:]) + "</div></details>" if more > 0 else ""
    return (
        f"{head}<p>Each joint round its worst held-out window, most of the gap first.</p>"
        f'<div class="legend">{legend}</div><div class="grid">{"".join(figures[:OPEN_TRACES])}</div>{rest}</section>'
    )


def _shows_position(traces: Sequence[Trace]) -> bool:
    """Whether the position is drawn beside the output, which it is not where it is the output."""
    return any(trace.unit not in ("rad", "m") for trace in traces)


def by_share(files: DiagnosisFiles) -> list[tuple[int, Trace]]:
    """Traces with their numbers, the joint with the largest share of the gap first."""
    share = {cell.joint: cell.share for cell in files.cells if cell.family == "all"}
    return sorted(enumerate(files.traces), key=lambda item: -share.get(item[1].joint, 0.0))


def _trace(trace: Trace, index: int) -> str:
    numbers = [f'<b class="before">{number(rmse(trace, "before"))}</b>']
    numbers += [f'<b class="after">{number(rmse(trace, "after"))}</b>'] if has_after(trace) else []
    return (
        f"<figure><figcaption><b>{_text(trace.joint)}</b> <span>RMSE</span> {' → '.join(numbers)} "
        f"<span>{_text(trace.unit)} · {_text(trace.trial)}</span></figcaption>"
        f'<div class="chart" data-figure="trace{index}" role="img" aria-label="{_text(trace.joint)}"></div></figure>'
    )


def remains(content: Content) -> str:
    """How much is left, where, and which signals it depends on."""
    rest = content["unexplained"]
    if content["gap"] is None or rest["share_of_gap"] is None or content["verdict"] == "no_gap":
        return ""
    share = percent(left_share(content["gap"]))
    text = f"{share} of the gap is left, which is no more than noise."
    if rest["above_noise"]:
        text = (
            f"{share} of the gap is unexplained; of its square above the noise floor, {percent(rest['share_of_gap'])}."
        )
    if rest["above_noise"] and rest["where"] and rest["where"] != content["where"]:
        places = [f"{_text(_place(p))} {percent(p['share'])}" for p in rest["where"][:3]]
        text += f" Most of it, in squares: {'; '.join(places)}."
    machine = content["logs"]["joints"]
    bars = "".join(
        f"<tr><th>{_text(words(item['signal']))}</th><td>{_text(joints_text(item['joints'], machine))}</td>"
        f'<td class="n">{percent(item["share"])}</td><td style="width:40%"><div class="bar left">'
        f'<i style="width:{100 * item["share"]:.1f}%"></i></div></td></tr>'
        for item in rest["depends_on"]
    )
    if bars:
        bars = (
            "<p>Signals that predict it, by the share of its square that each accounts for – the trail of what is missing:</p>"
            f'<div class="scroll"><table class="plain"><tbody>{bars}</tbody></table></div>'
        )
    elif rest["above_noise"]:
        bars = "<p>No logged signal predicts it: look for a cause that is not in the logs.</p>"
    return f"<section><h2>What remains</h2><p>{text}</p>{bars}</section>"


def considered(content: Content) -> str:
    """Effects that were tried and not accepted, sortable."""
    items = sorted(content["effects_considered"], key=lambda item: -item["score"])
    if not items:
        return ""
    machine = content["logs"]["joints"]
    columns = [("effect", ""), ("joints", ""), ("score", "n"), ("closes alone", "n"), ("why not accepted", "")]
    head = "".join(f'<th class="{c}" scope="col"><button>{name}</button></th>' for name, c in columns)
    rows = []
    for item in items:
        shrink = item.get("shrink")
        rows.append(
            f"<tr><td>{_text(words(item['effect']))}</td><td>{_text(joints_text(item['joints'], machine))}</td>"
            f'<td class="n" data-value="{item["score"]:.6g}">{number(item["score"])}</td>'
            f'<td class="n" data-value="{-1 if shrink is None else shrink:.6g}">'
            f"{'–' if shrink is None else percent(shrink)}</td><td>{_text(item.get('reason') or '–')}</td></tr>"
        )
    table = (
        f'<div class="scroll"><table class="plain"><thead><tr>{head}</tr></thead>'
        f"<tbody>{''.join(rows)}</tbody></table></div>"
    )
    if len(rows) > OPEN_ROWS:
        table = f"<details><summary>{len(rows)} entries, the strongest first</summary>{table}</details>"
    head = f"<h2>Effects tried and not accepted</h2><p>The score is {_score(items)}; a heading sorts.</p>"
    return f"<section>{head}{table}</section>"


def _score(items: Sequence[Content]) -> str:
    """What the score of the effects considered is: they were fitted alone, or beside those that were found."""
    if any(item.get("shrink") is not None for item in items):
        return "how many standard errors the held-out error fell by with this effect alone"
    return "how many standard errors the effect stands out by, beside those that were found"


def next_step(files: DiagnosisFiles) -> str:
    """The next experiment, and what to do with the model that was found."""
    content, steps = files.content, []
    if content["next_experiment"]:
        steps.append(with_code(content["next_experiment"]))
    if content["causes"] and files.has_model:
        steps.append("Retrain with the causes in the model: <code>hqpipe retrain --actuator</code> with this folder.")
    if content["verdict"] == "no_gap":
        steps.append("Train with this model as it is; more detail in it could not be checked on these logs.")
    if not steps:
        return ""
    return f'<section><h2>What to do next</h2><div class="next">{"".join(f"<p>{s}</p>" for s in steps)}</div></section>'


def left_out(content: Content) -> str:
    """What of the logs the answer does without, why, and what to do about it."""
    items = "".join(
        f"<li><b>{_text(left_out_words(item))}</b>: {with_code(item['reason'])}; {with_code(item['fix'])}</li>"
        for item in content.get("left_out") or []
    )
    return f"<section><h2>Left out of the answer</h2><ul>{items}</ul></section>" if items else ""


def warnings(content: Content) -> str:
    """What the reader should know before believing the numbers."""
    items = "".join(f"<li>{with_code(text)}</li>" for text in content["warnings"])
    return f"<section><h2>Warnings</h2><ul>{items}</ul></section>" if items else ""


def made(content: Content, provenance: Mapping[str, str]) -> str:
    """How the numbers were made."""
    logs, gap = content["logs"], content["gap"]
    rows = {
        "logs": logs["path"],
        "sha256": logs["sha256"],
        "trials": str(logs["trials"]),
        "joints": ", ".join(logs["joints"]),
        "control mode": logs["control_mode"] or "not given",
    }
    if "reference" in content:
        rows["reference"] = f"{content['reference']['path']} ({content['reference']['kind']})"
    if gap is not None:
        rows["layer"] = words(gap["layer"])
        rows["metric"] = f"{words(gap['metric'])}, {run_words(gap, 0)} {1e3 * gap['window_s']:g} ms"
    rows |= {"command": f"hqpipe diagnose --logs {logs['path']}", "format": content["format"]} | dict(provenance)
    body = "".join(f'<tr><th>{_text(k)}</th><td class="mono">{_text(v)}</td></tr>' for k, v in rows.items())
    return (
        f'<section><h2>How the numbers were made</h2><table class="plain made"><tbody>{body}</tbody></table></section>'
    )


def log_name(content: Content) -> str:
    """The last part of the path of the logs."""
    parts = [part for part in re.split(r"[/\\]", content["logs"]["path"]) if part]
    return parts[-1] if parts else "logs"


def _place(place: Content) -> str:
    return place["joint"] if place["regime"] == "all" else f"{place['joint']} {words(place['regime'])}"


def _text(text: Any) -> str:
    return html.escape(str(text), quote=True)


def with_code(text: str) -> str:
    """Escaped text in which `…` is set as code."""
    return re.sub(r"`([^`]+)`", r"<code>\1</code>", _text(text))
