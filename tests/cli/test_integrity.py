"""A changed byte is found, named, and mended by --force."""

from __future__ import annotations

import json
import shutil

import pytest

from hqpipe.pipeline.hashing import file_hash


@pytest.fixture
def made(toy):
    toy("run", "all")
    return toy


def test_changed_byte_stops_the_run_and_force_mends_it(made):
    path = made.artifacts / "numbers" / "count.txt"
    expected = file_hash(path)
    path.write_text("5")
    answer = made("run", "all")
    assert answer.code == 3
    for part in ("artifacts/numbers/count.txt", expected[:12], file_hash(path)[:12], "hqpipe numbers --force"):
        assert part in answer.err
    assert made("numbers", "--force").code == 0
    assert made("run", "all").code == 0
    assert path.read_text() == "4"


def test_mend_names_the_profile_in_use(toy):
    toy("run", "all", "--profile", "ci")
    (toy.artifacts / "numbers" / "count.txt").write_text("5")
    assert "`hqpipe numbers --profile ci --force`" in toy("run", "all", "--profile", "ci").err
    assert "`hqpipe numbers --profile ci --force`" in toy("square-up", "--profile", "ci").err


def test_changed_input_stops_the_stage_that_reads_it(made):
    path = made.artifacts / "squares" / "squares.json"
    path.write_text("[1]")
    answer = made("report", "--force")
    assert answer.code == 3 and "squares.json" in answer.err and "hqpipe square-up --force" in answer.err


@pytest.mark.parametrize("damage", ["missing", "added", "link"])
def test_missing_and_added_files_are_found(made, damage):
    folder = made.artifacts / "numbers"
    if damage == "missing":
        (folder / "count.txt").unlink()
    elif damage == "added":
        (folder / "extra.txt").write_text("")
    else:
        (folder / "count.txt").unlink()
        (folder / "count.txt").symlink_to("/etc/hostname")
    for command in (["run", "all"], ["verify"]):
        answer = made(*command)
        assert answer.code == 3
        assert ("extra.txt" if damage == "added" else "count.txt") in answer.err


def test_changed_manifest_is_found(made):
    path = made.artifacts / "report" / "manifest.json"
    path.write_text(path.read_text().replace('"passed": true', '"passed": false'))
    for command in (["run", "all"], ["verify"]):
        answer = made(*command)
        assert answer.code == 3 and "manifest.json was changed" in answer.err
    assert made("report", "--force").code == 0
    assert made("verify").code == 0


def test_output_path_that_leads_out_is_refused(made):
    from hqpipe.errors import IntegrityError
    from hqpipe.pipeline.hashing import data_hash
    from hqpipe.pipeline.manifest import read_manifest

    folder = made.artifacts / "report"
    data = json.loads((folder / "manifest.json").read_text())
    data.pop("digest")
    data["outputs"] = {"../../../secret": "0" * 64}
    (folder / "manifest.json").write_text(json.dumps({**data, "digest": data_hash(data)}))
    with pytest.raises(IntegrityError, match="leads out of the artifact folder"):
        read_manifest(folder)


def test_link_that_leads_out_of_the_store_is_refused(made):
    link = made.artifacts / "report"
    link.unlink()
    link.symlink_to("/etc")
    answer = made("run", "all")
    assert answer.code == 3 and "not into the store" in answer.err


def test_lost_store_entry_is_made_again(made):
    shutil.rmtree((made.artifacts / "squares").resolve())
    answer = made("run", "all", "--json")
    assert answer.actions == {"numbers": "kept", "square-up": "ran", "report": "kept"}


def test_status_reports_damage_without_stopping(made):
    (made.artifacts / "squares" / "squares.json").write_text("[]")
    answer = made("status", "--json")
    assert answer.code == 3
    states = {stage["artifact"]: stage["state"] for stage in answer.data["stages"]}
    assert states["numbers"] == "current" and states["squares"] == "damaged"


def test_verify_finds_a_broken_chain(made):
    assert made("verify").code == 0
    made("numbers", "--set", "count=2")
    answer = made("verify", "--json")
    assert answer.code == 3
    problems = {check["artifact"]: check["problems"] for check in answer.data["artifacts"]}
    assert problems["numbers"] == [] and problems["report"] == []
    assert "made from numbers" in problems["squares"][0]


def test_verify_notes_an_outside_folder_that_changed(toy):
    (toy.root / "mine" / "part").mkdir(parents=True)
    (toy.root / "mine" / "part" / "numbers.json").write_text("[1]")
    toy("square-up", "--numbers", "mine")
    (toy.root / "mine" / "part" / "numbers.json").write_text("[2]")
    answer = toy("verify", "--json")
    assert answer.code == 0
    assert "has changed since" in answer.data["artifacts"][1]["notes"][0]
