"""The sections of the report of a whole chain as HTML, one function each; every name from a file is escaped."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import inf
from typing import Any

from hqpipe.report.chain_parts import Chain, Part, figure, hidden, table, text, wide
from hqpipe.report.diagnosis_read import read_files
from hqpipe.report.diagnosis_sections import with_code
from hqpipe.report.diagnosis_words import (
    confusions,
    joints_text,
    listed,
    number,
    parameter_name,
    parameter_text,
    percent,
    verdict_sentence,
    words,
)

DIAGNOSIS_PAGE = "diagnosis.html"


_MEASURES = (
    ("m/s off", "speed_error", 1.0, 3),
    ("rad/s off", "yaw_error", 1.0, 3),
    ("m aside", "drift", 1.0, 2),
    ("feet lifted, cm", "foot_clearance", 100.0, 1),
    ("hardest step, weights", "peak_force", 1.0, 2),
    ("lowest supply, bar", "lowest_supply", 1e-5, 0),
)
"""Column, measure of `run_scenarios`, factor, decimals."""


@dataclass(frozen=True)
class Section:
    """One result on the page.

    Attributes:
        artifact: that it shows.
        title: of the section.
        draw: (part, chain) → HTML below the title.
        headline: whether the headline of its record stands above that.
    """

    artifact: str
    title: str
    draw: Callable[[Part, Chain], str]
    headline: bool = True


def bootstrap(part: Part, chain: Chain) -> str:
    """Training without an actuator model."""
    caption = "Training of the policies that need no actuator model, in the simulator."
    curves = figure(part, "training.png", "training curves", caption)
    return curves + (hidden("Order by order", _followed(part, "position")) if part.record else "")


def rollouts(part: Part, chain: Chain) -> str:
    """The logs: walks, stress trials, what they excite."""
    caption = "What the logs excite: position error against torque, by kind of joint."
    drawn = figure(part, "distribution.png", "position error against torque", caption)
    if part.record is None:
        return drawn
    stress = [f"{text(name)}{' (fell)' if trial['fell'] else ''}" for name, trial in part.told("stress").items()]
    beside = f"<p>Stress trials, to which nothing is fitted: {', '.join(stress)}.</p>" if stress else ""
    return drawn + beside + hidden("Every walk", _walks(part.told("walks")))


def actuator(part: Part, chain: Chain) -> str:
    """The comparison of actuator models."""
    compared = "Held-out errors; grey: what any model must beat."
    stressed = "The same models where the robot drops, falls, is pushed."
    drawn = figure(part, "comparison.png", "errors of every actuator model", compared)
    drawn += figure(part, "stress.png", "errors in stress trials", stressed)
    more = figure(part, "fit.png", "measured and predicted torque", "The fitted model: a typical and the worst window.")
    more += figure(part, "fit_joints.png", "torque of every joint", "The worst window of every joint.")
    more += figure(part, "constants.png", "physical constants", "Constants read from the fit, beside the design.")
    return drawn + (hidden("The numbers", _models(part)) if part.record else "") + hidden("Fit and constants", more)


def _models(part: Part) -> str:
    held, stress = part.told("held_out_rmse"), part.told("stress_rmse")
    order = sorted(held, key=lambda name: inf if held[name]["free_run"] is None else held[name]["free_run"])
    rows = [
        (
            text(name),
            number(held[name]["one_step"]),
            f"<b>{number(held[name]['free_run'])}</b>",
            number(stress[name]["free_run"]) if name in stress else "–",
        )
        for name in order
    ]
    floor = number(part.told("noise_floor"))
    head = ("actuator model", "one step ahead", "free-running", "in stress trials")
    return (
        table(head, rows) + f'<p class="soft">RMSE in N·m on held-out trials; the sensor\'s noise alone is {floor}.</p>'
    )


def diagnosis(part: Part, chain: Chain) -> str:
    """Verdict, gap and causes."""
    content = read_files(part.folder).content
    parts = [f"<p class=lead>{text(verdict_sentence(content))}</p>"]
    if chain.gap is not None:
        caption = "The free-running error on held-out trials, cause by cause, with 95 % intervals."
        parts.append(
            f"<figure>{wide(chain.gap, 'the gap before, its causes, and after')}<figcaption>{caption} "
            f"<span class=from>{text(part.shown)}/diagnosis.json</span></figcaption></figure>"
        )
    if content["causes"]:
        parts.append(_causes(content))
    if content["next_experiment"]:
        parts.append(f"<p>Next: {with_code(content['next_experiment'])}.</p>")
    parts += [f'<p class="soft">Warning: {with_code(warning)}.</p>' for warning in content["warnings"]]
    if (part.folder / DIAGNOSIS_PAGE).is_file():
        parts.append(f'<p><a href="{DIAGNOSIS_PAGE}">The whole diagnosis</a>, beside this page.</p>')
    return "".join(parts)


def _causes(content: Mapping[str, Any]) -> str:
    rows = []
    for cause in content["causes"]:
        found = "<br>".join(
            f"{text(parameter_name(key))} {text(value)} <span class=soft>({text(interval)})</span>"
            for key, (value, interval) in ((k, parameter_text(p)) for k, p in cause["parameters"].items())
        )
        other = confusions(cause)
        doubt = f"<br><span class=soft>or {text(listed(other, 'or'))}</span>" if other else ""
        rows.append(
            (
                f"<b>{text(words(cause['effect']))}</b>{doubt}",
                text(joints_text(cause["joints"], content["logs"]["joints"])),
                found or "–",
                percent(cause["shrink"]),
                percent(cause["probability"]),
            )
        )
    return table(("cause", "joints", "size, with its 95 % interval", "closes", "probability"), rows, words=3)


def policy(part: Part, chain: Chain) -> str:
    """Training with the actuator model in the loop."""
    caption = "Training with the actuator model in the loop, in the simulator."
    curves = figure(part, "training.png", "training curves", caption)
    return curves + (hidden("Order by order", _followed(part)) if part.record else "")


def _followed(part: Part, *where: str) -> str:
    """How well a policy follows its orders in the simulator, beside the prior alone."""
    learned, prior = (part.told(*where, name, "commands") for name in ("policy", "zero_action_baseline"))
    rows = [
        (_velocity(a["command"]), _velocity(a["velocity"]), _velocity(b["velocity"]), f"{a['falls']} of {a['robots']}")
        for a, b in zip(learned, prior, strict=True)
    ]
    head = ("ordered", "policy", "zero action", "fell when pushed")
    return (
        table(head, rows) + '<p class="soft">Forward and sideways speed in m/s, turning in rad/s; in the simulator.</p>'
    )


def _velocity(values: Sequence[float]) -> str:
    return ",&nbsp;".join(f"{value:.2f}".replace("-0.00", "0.00").replace("-", "−") for value in values)


def onnx(part: Part, chain: Chain) -> str:
    """The exported graph."""
    if part.record is None:
        return ""
    return f"<p>policy.onnx has {part.told('bytes') / 1e3:.0f} kB; what goes in and out of it is in deploy.yaml beside it.</p>"


def validation(part: Part, chain: Chain) -> str:
    """The gate, check by check."""
    if part.record is None:
        return ""
    checks = part.told("checks")
    rows = []
    for check in checks:
        value, limit = check["value"], check["limit"]
        passed = value is not None and value <= limit
        mark = "<b class=ok>✓ passed</b>" if passed else "<b class=bad>✗ missed</b>"
        rows.append((text(check["check"]), mark, number(value), f"≤ {number(limit)}"))
    return table(("check", "", "value", "limit"), rows, words=2) + _scenarios(part.told("scenarios"))


def _scenarios(rows: Sequence[Mapping[str, Any]]) -> str:
    """The worst walk of every scenario."""
    cells = []
    for row in rows:
        falls = f"{row['falls']} of {row['walks']}"
        worst = [
            "–" if (value := row["worst"].get(name)) is None else f"{factor * value:.{decimals}f}"
            for _, name, factor, decimals in _MEASURES
        ]
        cells.append((text(row["title"]), f"<b class=bad>{falls}</b>" if row["falls"] else falls, *worst))
    head = ("on the plant, the worst walk", "fell", *(title for title, *_ in _MEASURES))
    return table(head, cells, words=1)


def _walks(walks: Mapping[str, Mapping[str, Any]]) -> str:
    rows = [
        (
            text(name),
            f"<b class=bad>after {walk['seconds']:.1f} s</b>" if walk["fell"] else "no",
            f"{walk['speed']:.2f}",
            f"{walk['distance']:.1f}",
            f"{walk['drift']:.2f}",
        )
        for name, walk in walks.items()
    ]
    return table(("walk on the plant", "fell", "m/s", "m ahead", "m aside"), rows, words=2)


def comparison(part: Part, chain: Chain) -> str:
    """Controllers trained with different actuator models."""
    curves = figure(
        part,
        "learning_curves.png",
        "learning curves",
        "Reward and speed error in the simulator, each with its own actuator model.",
    )
    return curves + figure(part, "plant.png", "measures on the plant", "The same orders on the plant, walk by walk.")


SECTIONS = (
    Section("bootstrap", "First policy, without an actuator model", bootstrap),
    Section("rollouts", "Logs of the machine", rollouts),
    Section("actuator", "Actuator models", actuator),
    Section("diagnosis", "Diagnosis of the gap", diagnosis, headline=False),
    Section("policy", "Policy, trained with the model", policy),
    Section("onnx", "Export", onnx),
    Section("validation", "Validation on the plant", validation),
    Section("comparison", "Controllers compared", comparison),
)
"""In the order of the chain. A further one is a function and a row here."""
