"""The page of a diagnosis: every kind of answer, missing files, foreign names, one file without a network."""

from __future__ import annotations

import html
import json
import re
from dataclasses import replace
from html.parser import HTMLParser

import plotly.graph_objects as go
import pytest
from diagnosis_cases import (
    CASES,
    QUADRUPED,
    cause,
    explained,
    gap,
    mixed_units,
    no_gap,
    renamed,
    residual_rows,
    unknown,
    write_case,
)

from hqpipe.errors import UsageError
from hqpipe.machine import EFFECTS
from hqpipe.report.diagnosis_advice import OTHERS
from hqpipe.report.diagnosis_charts import has_after, rmse, trace_chart, waterfall
from hqpipe.report.diagnosis_heat import heat_table
from hqpipe.report.diagnosis_page import write_page
from hqpipe.report.diagnosis_read import read_files
from hqpipe.report.diagnosis_words import parameter_name, parameter_text, percent, verdict_sentence

VOID = {"meta", "br"}


class Reader(HTMLParser):
    """Text outside scripts and style, the tags, and whether every tag is closed in order."""

    def __init__(self) -> None:
        super().__init__(convert_charrefs=True)
        self.open: list[str] = []
        self.tags: list[tuple[str, dict]] = []
        self.parts: list[str] = []

    def handle_starttag(self, tag, attributes):
        self.tags.append((tag, dict(attributes)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if not {"script", "style"} & set(self.open):
            self.parts.append(data)

    @property
    def text(self) -> str:
        return re.sub(r"\s+", " ", " ".join(self.parts))


def read(path) -> tuple[Reader, dict]:
    source = path.read_text(encoding="utf-8")
    reader = Reader()
    reader.feed(source)
    assert not reader.open
    figures = json.loads(re.search(r'id="figures">(.*?)</script>', source, re.S)[1])
    return reader, figures


SECTIONS = [
    "Causes",
    "Where it is",
    "Measured against the model",
    "What remains",
    "Effects tried and not accepted",
    "What to do next",
    "Warnings",
    "How the numbers were made",
]


def test_sections_come_in_the_order_of_the_readers_questions(tmp_path):
    reader, _ = read(write_page(write_case(tmp_path, explained())))
    at = [reader.text.index(name) for name in ["from 67.4 N·m down to 6.3 N·m", *SECTIONS]]
    assert at == sorted(at)


@pytest.mark.parametrize("name", CASES)
def test_every_answer_makes_a_whole_page_whose_charts_plotly_accepts(name, tmp_path):
    case = CASES[name]()
    reader, figures = read(write_page(write_case(tmp_path, case)))
    assert verdict_sentence(case) in reader.text
    wanted = [attributes["data-figure"] for _, attributes in reader.tags if "data-figure" in attributes]
    assert sorted(wanted) == sorted(figures)
    assert bool(figures) == (case["gap"] is not None)
    for figure in figures.values():
        go.Figure(data=figure["data"], layout=figure["layout"])  # raises on a property that plotly does not know


def test_the_page_loads_nothing_from_outside_and_holds_the_library_once(tmp_path):
    path = write_page(write_case(tmp_path, explained()))
    reader, _ = read(path)
    assert not [a for _, attributes in reader.tags for a in ("src", "href") if a in attributes]
    source = path.read_text(encoding="utf-8")
    assert "@import" not in source and "url(" not in source and source.count('id="plotly"') == 1
    assert path.stat().st_size < 4e6
    bare = write_page(write_case(tmp_path / "bare", CASES["not_identifiable"]()))
    assert bare.stat().st_size < 5e4  # without a chart the library stays out


def test_the_same_files_give_the_same_bytes(tmp_path):
    first = write_page(write_case(tmp_path, explained())).read_bytes()
    assert write_page(tmp_path).read_bytes() == first


def test_names_from_files_cannot_become_markup(tmp_path):
    bad = "</script><b onload='x'>&LFK"
    case = renamed(explained(), [*QUADRUPED[:2], bad, *QUADRUPED[3:]])
    case["warnings"] = [f"{bad} looks odd"]
    case["next_experiment"] = f"move {bad}"
    case["logs"]["path"] = f"/data/{bad}"
    path = write_page(write_case(tmp_path, case), provenance={"seed": bad})
    reader, figures = read(path)
    assert bad not in path.read_text(encoding="utf-8")
    assert not [tag for tag, attributes in reader.tags if "onload" in attributes]
    assert f"{bad} looks odd" in reader.text and f"move {bad}" in reader.text
    assert html.escape(bad[:20]) in json.dumps(figures["waterfall"])


def test_waterfall_leads_from_before_to_after(tmp_path):
    bars, whiskers = waterfall(explained())["data"]
    ends = [base + (0 if i else length) for i, (base, length) in enumerate(zip(bars["base"], bars["x"], strict=True))]
    assert ends[0] == 0.337 and bars["x"][-1] == 0.0315
    assert ends[1] == pytest.approx(0.337 * (1 - 0.468)) and ends[2] == pytest.approx(0.337 * (1 - 0.468 - 0.2715))
    assert len(bars["x"]) == 5 and ends[3] == pytest.approx(0.0315, abs=3e-4)
    assert whiskers["error_x"]["array"] == pytest.approx([0.03 * 0.337] * 3)
    assert waterfall(explained())["layout"]["shapes"][0]["x0"] == 0.0105


def test_waterfall_shows_what_the_causes_do_not_add_up_to_and_a_cause_that_hurts():
    case = explained()
    case["causes"][2]["shrink"], case["causes"][2]["shrink_ci95"] = -0.05, [-0.08, -0.02]
    figure = waterfall(case)
    labels = figure["layout"]["yaxis"]["ticktext"]
    assert any("not shared out" in label for label in labels) and any("+5%" in label for label in labels)
    assert min(figure["data"][0]["x"]) >= 0.0


def test_far_persistence_does_not_dwarf_the_bars():
    case = explained()
    case["gap"]["normalised"]["persistence"] = 4.5
    assert waterfall(case)["layout"]["xaxis"]["range"][1] < 0.4
    assert len(waterfall(case)["layout"]["shapes"]) == 1


def test_cards_say_what_was_found_and_what_to_do(tmp_path):
    reader, _ = read(write_page(write_case(tmp_path, explained()), effects=EFFECTS))
    for text in (
        "half width 6.20 mrad 5.95 … 6.45 mrad",
        "delay 4.80 ms",
        "closes 27% of the gap (24% … 30%)",
        "all 12 joints",
        "These logs cannot tell it from torque bias or coulomb friction with position bias.",
        EFFECTS["valve_deadband"].advice,
        EFFECTS["command_delay"].meaning,
    ):
        assert text in reader.text


def test_an_effect_without_advice_still_gets_a_card(tmp_path):
    case = explained()
    case["causes"] = [cause("pump_ripple", ["LFK"], 0.9, ("amplitude_nm", 3.0, 0.2, "N·m"))]
    reader, _ = read(write_page(write_case(tmp_path, case)))
    assert "pump ripple" in reader.text and "amplitude 3.00 N·m" in reader.text


def test_missing_files_are_said(tmp_path):
    folder = write_case(tmp_path, explained(), traces=False)
    (folder / "residuals.csv").unlink()
    (folder / "actuator.json").unlink()
    reader, figures = read(write_page(folder))
    assert "no residuals.csv" in reader.text and "no traces.json" in reader.text
    assert "hqpipe retrain" not in reader.text and list(figures) == ["waterfall"]


def test_tables_before_and_after(tmp_path):
    reader, _ = read(write_page(write_case(tmp_path / "a", explained())))
    assert "Before: per cent of 67.4 N·m" in reader.text and "After: per cent of the 6.3 N·m" in reader.text
    reader, _ = read(write_page(write_case(tmp_path / "b", explained(), after=False)))
    assert "Share of the gap, per cent" in reader.text and "After: per cent" not in reader.text
    reader, _ = read(write_page(write_case(tmp_path / "c", unknown())))  # nothing found: before and after are one
    assert "After: per cent" not in reader.text


def test_heat_table_keeps_the_machines_order_and_frames_what_is_named(tmp_path):
    files = read_files(write_case(tmp_path, explained()))
    table = heat_table(files.cells, QUADRUPED, named={("LFK", "reversal")})
    assert re.findall(r'<th scope="row"[^>]*>(\w+)<', table) == QUADRUPED
    regimes = re.findall(r"<span>([^<]+)</span>", table)
    assert regimes[0] == "all" and regimes.index("5–20 Hz") < regimes.index("20–100 Hz")
    assert "no impact" not in regimes and "impact" in regimes
    framed = re.findall(r'named[^>]*title="([^"]*)"', table)
    row = next(r for r in residual_rows(explained()) if (r["joint"], r["regime"]) == ("LFK", "reversal"))
    assert len(framed) == 1 and framed[0].startswith(f"LFK, reversal: {percent(row['share'])} of the gap (")
    assert "20% of the time" in framed[0]


def test_a_regime_that_a_joint_never_shows_is_hatched(tmp_path):
    cells = read_files(write_case(tmp_path, explained())).cells
    fewer = [c for c in cells if (c.joint, c.regime) != ("RHK", "impact")]
    assert heat_table(fewer, QUADRUPED).count("no samples") == 1


def test_many_joints_fold_and_the_worst_come_first(tmp_path):
    case = renamed(explained(), [f"joint_{i:02d}" for i in range(40)])
    reader, figures = read(write_page(write_case(tmp_path, case)))
    assert "28 more joints" in reader.text and len(figures) == 41
    worst = next(a["aria-label"] for _, a in reader.tags if a.get("data-figure", "").startswith("trace"))
    assert worst == case["where"][0]["joint"]


def test_one_prismatic_joint_keeps_its_units(tmp_path):
    case = renamed(explained(), ["slide"])
    case["gap"]["unit"] = "N"
    reader, figures = read(write_page(write_case(tmp_path, case)))
    assert "The force error is explained" in reader.text and "N·m" not in reader.text
    titles = [figures["trace0"]["layout"][axis]["title"]["text"] for axis in ("yaxis", "yaxis2")]
    assert titles == ["N", "m"] and "1 joint" in reader.text


def test_joints_in_different_units_share_no_size_in_a_unit(tmp_path):
    reader, figures = read(write_page(write_case(tmp_path, mixed_units())))
    assert "from 34% of the spread down to 3.1% of the spread" in reader.text
    assert "swing N·m 900 303 (34%)" in reader.text and "boom N 40 13.5 (34%)" in reader.text
    assert figures["waterfall"]["data"][0]["base"][0] == 0.0 and figures["waterfall"]["data"][0]["x"][0] == 0.337


def test_a_file_of_the_first_format_is_shown(tmp_path):
    case = explained() | {"format": "hqpipe-diagnosis/1"}
    del case["gap"]["normalised"]
    write_case(tmp_path, explained())
    (tmp_path / "diagnosis.json").write_text(json.dumps(case), encoding="utf-8")
    reader, figures = read(write_page(tmp_path))
    assert "from 67.4 N·m down to 6.3 N·m" in reader.text
    assert figures["waterfall"]["data"][0]["x"][0] == 1.0


def test_traces_draw_restarts_and_leave_out_what_does_not_differ(tmp_path):
    trace = read_files(write_case(tmp_path / "a", explained())).traces[0]
    figure = trace_chart(trace, "position")
    assert [c["name"] for c in figure["data"]] == ["measured", "model before", "model after", "command", "position"]
    assert [shape["x0"] for shape in figure["layout"]["shapes"]] == trace.restarts
    assert rmse(trace, "after") < 0.2 * rmse(trace, "before")
    same = read_files(write_case(tmp_path / "b", unknown())).traces[0]
    assert not has_after(same) and len(trace_chart(same, "position")["data"]) == 4
    valve = trace_chart(replace(trace, unit="rad/s"), "valve")  # a valve command shares no axis with a position
    assert [c["name"] for c in valve["data"] if c["yaxis"] == "y2"] == ["command"]
    torque = trace_chart(trace, "torque")
    assert [c["name"] for c in torque["data"] if c["yaxis"] == "y2"] == ["position"]


def test_other_layers_are_listed(tmp_path):
    case = explained()
    case["gaps"] = [case["gap"], gap(4.0, 4.0, 3.5, 9.0) | {"layer": "rigid_body"}]
    reader, _ = read(write_page(write_case(tmp_path, case)))
    assert "rigid body: 4 N·m → 4 N·m, noise floor 3.5 N·m" in reader.text


def test_what_remains_names_its_signals_and_noise_does_not(tmp_path):
    reader, _ = read(write_page(write_case(tmp_path / "a", unknown())))
    assert "velocity of neighbours" in reader.text and "100% of the gap is unexplained" in reader.text
    assert "of its square above the noise floor, 100%" in reader.text
    reader, _ = read(write_page(write_case(tmp_path / "b", no_gap())))
    assert "What remains" not in reader.text


@pytest.mark.parametrize(
    "name,text,message",
    [
        ("diagnosis.json", "{", "not JSON"),
        ("diagnosis.json", "{}", "format: expected hqpipe-diagnosis/2 or hqpipe-diagnosis/1, got null"),
        ("residuals.csv", "trial,joint\nall,LFK\n", "no column 'family'"),
        ("traces.json", '{"joints": []}', "joints: expected an object, got a list"),
        ("traces.json", '{"joints": {"LFK": {"time": [0]}}}', "joints.LFK: missing field 'measured'"),
        (
            "traces.json",
            '{"joints": {"LFK": {"time": [0, 1], "measured": [1], "before": [1, 2]}}}',
            "joints.LFK.measured: expected 2 elements, got 1",
        ),
    ],
)
def test_a_broken_file_is_named(name, text, message, tmp_path):
    write_case(tmp_path, explained())
    (tmp_path / name).write_text(text, encoding="utf-8")
    with pytest.raises(UsageError, match=re.escape(message)) as error:
        write_page(tmp_path)
    assert str(tmp_path / name) in str(error.value)


def test_no_diagnosis_is_said(tmp_path):
    with pytest.raises(UsageError, match="no such file"):
        write_page(tmp_path)


@pytest.mark.parametrize(
    "value,unit,ci95,expected",
    [
        (0.0062, "rad", [0.0060, 0.0065], ("6.20 mrad", "6.00 … 6.50 mrad")),
        (0.0048, "s", [0.0046, 0.0050], ("4.80 ms", "4.60 … 5.00 ms")),
        (1200.0, "N·m", [1150.0, 1260.0], ("1200 N·m", "1150 … 1260 N·m")),
        (0.5, "command", [0.4, 0.6], ("0.50 command units", "0.40 … 0.60 command units")),
        (-0.05, "1", [-0.06, -0.04], ("−0.050", "−0.060 … −0.040")),
        (0.25, "rad", [0.25, 0.25], ("0.250000 rad", "0.250000 … 0.250000 rad")),
    ],
)
def test_parameters_carry_the_digits_of_their_interval(value, unit, ci95, expected):
    assert parameter_text({"value": value, "unit": unit, "ci95": ci95}) == expected


@pytest.mark.parametrize(
    "name,expected",
    [
        ("delay_s", "delay"),
        ("nm_s_per_rad", "value"),
        ("slope_per_rad", "slope"),
        ("ki", "ki"),
        ("gap", "gap"),
        ("natural_hz", "natural frequency"),
    ],
)
def test_parameter_names_lose_their_unit(name, expected):
    assert parameter_name(name) == expected


@pytest.mark.parametrize("value,expected", [(0.0, "0%"), (0.002, "<1%"), (-0.05, "−5%"), (0.914, "91%"), (1.0, "100%")])
def test_percent(value, expected):
    assert percent(value) == expected


def test_no_cause_is_explained_twice():
    assert not set(EFFECTS) & set(OTHERS)
