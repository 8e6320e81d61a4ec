"""Compiled code is compiled anew when any module changes that it was made from."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from hqpipe.actuators.loops import actuator_step, laws
from hqpipe.system import imported_sources
from hqpipe.system.imported_sources import digest_of_sources

SOURCES = {
    "loop.py": "from toy.parts.step import advance\n",
    "parts/__init__.py": "",
    "parts/step.py": "from toy import columns\nimport numpy\n",
    "columns.py": "WIDTH = 3\n",
    "other.py": "from toy import columns\n",
}


@pytest.fixture
def toy(tmp_path, monkeypatch) -> Iterator[Path]:
    for name, text in SOURCES.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    monkeypatch.setattr(imported_sources, "_ROOT", tmp_path)
    monkeypatch.setattr(imported_sources, "PACKAGE", "toy")
    yield tmp_path
    forget()


def forget():
    """What was read, as in a new process."""
    imported_sources._read.cache_clear()
    digest_of_sources.cache_clear()


def changed(folder: Path, name: str) -> bool:
    """Whether a change of one file changes what the loop rests on."""
    before = digest_of_sources(folder / "loop.py")
    (folder / name).write_text("WIDTH = 4\n")
    forget()
    return digest_of_sources(folder / "loop.py") != before


@pytest.mark.parametrize("name", ["loop.py", "parts/step.py", "columns.py"])
def test_a_change_of_what_a_module_imports_counts(toy, name):
    assert changed(toy, name)


def test_a_change_elsewhere_does_not(toy):
    assert not changed(toy, "other.py")


def test_the_cache_of_a_loop_goes_by_them():
    file = Path(actuator_step.__file__)
    stamp = actuator_step.table_row._cache._cache_file._source_stamp
    assert stamp[1] == digest_of_sources(file)
    assert Path(laws.__file__) in imported_sources._read(file)[1]
