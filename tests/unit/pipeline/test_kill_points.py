"""A kill before any file operation of the store leaves the old or the new result, whole, and nothing else."""

from __future__ import annotations

import shutil
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from hqpipe.pipeline.collect_garbage import Garbage, remove
from hqpipe.pipeline.hashing import hash_files
from hqpipe.pipeline.manifest import Manifest, Recipe
from hqpipe.pipeline.store import Store
from hqpipe.system import durable

sys.path.append(str(Path(__file__).parents[2]))
from file_operations import each_kill

RECIPE = Recipe(stage="fit", version=1, params={}, seed=1, inputs={}, robot="f" * 64)
MADE = {"created": "2026-01-01T00:00:00+00:00", "profile": "ci", "wall_time_s": 1.0}
FILES = ("a.txt", "part/b.txt", "part/c.txt")


def commit(store: Store, text: str, recipe: Recipe = RECIPE) -> None:
    folder = store.begin(recipe.key)
    for name in FILES:
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text)
    store.commit(folder, Manifest(recipe, {}, hash_files(folder), {}, MADE))


def text_of(store: Store, recipe: Recipe = RECIPE) -> str | None:
    """What the result holds, after every byte of it was verified; None if there is none."""
    entry = store.get(recipe.key)
    if entry is None:
        return None
    entry.verify()
    (text,) = {(entry.path / name).read_text() for name in FILES}
    return text


def start_again(store: Store) -> None:
    """What the next run does first; nothing temporary is left after it."""
    store.remove_leftovers()
    assert not [path for path in store.folder.rglob("*") if path.name.startswith(".tmp-")]


@pytest.fixture
def store(tmp_path) -> Store:
    return Store(tmp_path / "artifacts")


def with_old(store: Store) -> None:
    shutil.rmtree(store.folder, ignore_errors=True)
    commit(store, "old")
    store.make_current("fit", RECIPE.key)


@pytest.mark.parametrize("exchange", [True, False])
def test_a_forced_run_never_loses_the_old_result(store, monkeypatch, exchange):
    if not exchange:
        monkeypatch.setattr(durable, "_exchange", lambda first, second: False)
    seen = []
    for _ in each_kill(lambda: commit(store, "new"), lambda: with_old(store)):
        if exchange:
            assert text_of(store) in ("old", "new")  # at every moment, also before anything is put back
        start_again(store)
        seen.append(text_of(store))
        assert store.current("fit") is not None
    assert len(seen) > 20 and set(seen) == {"old", "new"}
    assert seen == sorted(seen, reverse=True)
    assert text_of(store) == "new"


def test_a_first_run_leaves_nothing_or_the_result(store):
    seen = []
    for _ in each_kill(lambda: commit(store, "new"), lambda: shutil.rmtree(store.folder, ignore_errors=True)):
        start_again(store)
        seen.append(text_of(store))
    assert len(seen) > 20 and set(seen) == {None, "new"}


def test_the_link_points_to_the_old_or_to_the_new_result(store):
    other = replace(RECIPE, seed=2)

    def prepare() -> None:
        with_old(store)
        commit(store, "other", other)

    seen = set()
    for _ in each_kill(lambda: store.make_current("fit", other.key), prepare):
        start_again(store)
        seen.add(store.current_key("fit"))
    assert seen == {RECIPE.key, other.key}


def test_removed_garbage_is_whole_or_gone(store):
    item = Garbage(store.path(RECIPE.key), "", 0)
    seen = []
    for _ in each_kill(lambda: remove([item]), lambda: with_old(store)):
        seen.append(text_of(store))
        start_again(store)
        assert text_of(store) == seen[-1]
    assert set(seen) == {"old", None}


def test_a_killed_removal_of_leftovers_is_done_by_the_next(store):
    def prepare() -> None:
        with_old(store)
        folder = store.begin(RECIPE.key)
        (folder / "part").mkdir()
        (folder / "part" / "half").write_text("half")
        store.path(RECIPE.key).rename(store.entries_folder / f"{durable.REPLACED}{RECIPE.key}")

    for _ in each_kill(store.remove_leftovers, prepare):
        start_again(store)
        assert text_of(store) == "old"
