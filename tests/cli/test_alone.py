"""A stage that runs by its own name only."""

from __future__ import annotations

import pytest
from toy_pipeline import TABLE, ReportParams, _module

from hqpipe.cli import run_cli
from hqpipe.pipeline.stage import Input, Stage, StageTable


def draw_poster(context) -> dict:
    (context.output / "poster.txt").write_text((context.inputs["squares"] / "squares.json").read_text())
    return {}


WITH_POSTER = StageTable(
    [
        *TABLE.values(),
        Stage(
            "poster",
            "poster",
            _module("toy_poster", draw_poster, ReportParams),
            "Draw them.",
            inputs=(Input("squares", "squares", "--squares"),),
            alone=True,
        ),
    ],
    template=TABLE.template,
)


@pytest.fixture
def hqpipe(toy):
    def command(*arguments: str):
        toy.capture.readouterr()
        code = run_cli(WITH_POSTER, arguments)
        out, err = toy.capture.readouterr()
        return code, out, err

    return command


def test_the_chain_leaves_it_out_and_is_complete_without(toy, hqpipe):
    assert hqpipe("run", "all")[0] == 0
    assert not (toy.artifacts / "poster").exists()
    code, out, _ = hqpipe("status")
    assert code == 0 and "poster" in out and "missing" in out


def test_it_is_made_by_name_and_grows_stale_without_failing_the_chain(toy, hqpipe):
    hqpipe("run", "all")
    assert hqpipe("poster")[0] == 0
    assert (toy.artifacts / "poster" / "poster.txt").is_file()
    assert hqpipe("run", "all", "--set", "square_up.offset=1")[0] == 0
    toy.edit("offset: 0", "offset: 1")
    code, out, _ = hqpipe("status")
    assert code == 0 and "stale" in out
    code, out, _ = hqpipe("verify")
    assert code == 0 and "poster" in out and "the current one is" in out


def test_damage_to_it_counts(toy, hqpipe):
    hqpipe("run", "all")
    hqpipe("poster")
    path = toy.artifacts / "poster" / "poster.txt"
    path.chmod(0o644)
    path.write_text("changed")
    assert hqpipe("status")[0] == 3
    assert hqpipe("verify")[0] == 3


@pytest.mark.parametrize("option", ["--from", "--until"])
def test_it_is_no_end_of_the_chain(hqpipe, option):
    code, _, err = hqpipe("run", "all", option, "poster")
    assert code == 2 and "run it as `hqpipe poster`" in err


def test_help_names_it_apart(hqpipe):
    out = hqpipe("--help")[1]
    assert out.index("Stages that run alone") < out.index("poster  ") < out.index("Commands")
