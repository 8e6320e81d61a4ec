"""Hashing, records, and the store, without the command line."""

from __future__ import annotations

import os
from dataclasses import replace

import pytest

from hqpipe.errors import IntegrityError, UsageError
from hqpipe.pipeline.hashing import canonical_json, data_hash, file_hash, list_files, tree_hash
from hqpipe.pipeline.manifest import Manifest, Recipe, read_manifest
from hqpipe.pipeline.store import Store

RECIPE = Recipe(stage="fit", version=1, params={"a": 1.0}, seed=1, inputs={"logs": "0" * 64}, robot="f" * 64)


MADE = {"created": "2026-01-01T00:00:00+00:00", "profile": "ci", "wall_time_s": 1.0}


def commit(store: Store, text: str, recipe: Recipe = RECIPE):
    folder = store.begin(recipe.key)
    (folder / "out.txt").write_text(text)
    outputs = {"out.txt": file_hash(folder / "out.txt")}
    return store.commit(folder, Manifest(recipe, {}, outputs, {"m": 1}, MADE))


def test_canonical_json_does_not_depend_on_order_and_refuses_nan():
    assert canonical_json({"b": 1, "a": [2.0]}) == canonical_json({"a": [2.0], "b": 1}) == '{"a":[2.0],"b":1}'
    with pytest.raises(ValueError, match="Out of range"):
        canonical_json(float("nan"))


def test_known_hash(tmp_path):
    (tmp_path / "a").write_bytes(b"abc")
    # FIPS 180-2, appendix B.1.
    assert file_hash(tmp_path / "a") == "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"


def test_tree_hash_sees_names_and_bytes_but_not_times(tmp_path):
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "a").write_text("1")
    before = tree_hash(tmp_path)
    os.utime(tmp_path / "sub" / "a", (0, 0))
    assert tree_hash(tmp_path) == before
    (tmp_path / "sub" / "a").rename(tmp_path / "sub" / "b")
    assert tree_hash(tmp_path) != before
    (tmp_path / "__pycache__").mkdir()
    (tmp_path / "__pycache__" / "x").write_text("")
    assert list_files(tmp_path, ignore=frozenset({"__pycache__"})) == ["sub/b"]


def test_links_and_pipes_are_refused(tmp_path):
    (tmp_path / "d").mkdir()
    (tmp_path / "d" / "link").symlink_to(tmp_path)
    with pytest.raises(UsageError, match="symbolic link"):
        tree_hash(tmp_path / "d", links=True)
    (tmp_path / "d" / "link").unlink()
    os.mkfifo(tmp_path / "d" / "pipe")
    with pytest.raises(UsageError, match="special file"):
        tree_hash(tmp_path / "d")


@pytest.mark.parametrize(
    "change",
    [
        {"stage": "x"},
        {"version": 2},
        {"params": {"a": 2.0}},
        {"seed": 2},
        {"inputs": {"logs": "1" * 64}},
        {"inputs": {"other": "0" * 64}},
        {"robot": "x"},
    ],
)
def test_every_part_of_the_recipe_is_in_the_key(change):
    assert replace(RECIPE, **change).key != RECIPE.key


def test_commit_and_read_back(tmp_path):
    store = Store(tmp_path / "artifacts")
    entry = commit(store, "a")
    store.make_current("fit", entry.manifest.key)
    assert store.current("fit") == entry == store.get(RECIPE.key)
    assert store.keys() == [RECIPE.key]
    assert entry.problems() == []


def test_content_is_the_same_for_the_same_bytes_made_in_another_way(tmp_path):
    store = Store(tmp_path)
    first, second = commit(store, "a"), commit(store, "a", replace(RECIPE, seed=2))
    assert first.manifest.key != second.manifest.key
    assert first.manifest.content == second.manifest.content


def test_commit_replaces_a_result_of_the_same_key(tmp_path):
    store = Store(tmp_path)
    commit(store, "a")
    commit(store, "b")
    assert (store.path(RECIPE.key) / "out.txt").read_text() == "b"
    assert store.get(RECIPE.key).problems() == []
    assert store.remove_leftovers() == []


def test_links_are_relative_so_that_the_folder_can_move(tmp_path):
    store = Store(tmp_path / "here")
    store.make_current("fit", commit(store, "a").manifest.key)
    (tmp_path / "here").rename(tmp_path / "there")
    assert Store(tmp_path / "there").current("fit").problems() == []


def test_leftovers_of_dead_processes_are_removed(tmp_path):
    store = Store(tmp_path)
    folder = store.begin(RECIPE.key)
    (folder / "half").write_text("half")
    (tmp_path / ".tmp-fit-1").symlink_to("nowhere")
    assert len(store.remove_leftovers()) == 2
    assert not folder.exists() and store.keys() == []


def test_discarded_folder_is_gone(tmp_path):
    store = Store(tmp_path)
    folder = store.begin(RECIPE.key)
    store.discard(folder)
    assert not folder.exists()


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"digest": 1}', '{"digest": 1, "format": "other/1"}', "{", "\xff"])
def test_file_that_is_no_manifest(tmp_path, text):
    (tmp_path / "manifest.json").write_text(text, encoding="latin-1")
    with pytest.raises(IntegrityError, match="manifest.json"):
        read_manifest(tmp_path)


def test_manifest_that_lacks_a_field(tmp_path):
    body = {"format": "hqpipe-artifact/1", "key": "x"}
    (tmp_path / "manifest.json").write_text(canonical_json({**body, "digest": data_hash(body)}))
    with pytest.raises(IntegrityError, match="lacks a field"):
        read_manifest(tmp_path)
