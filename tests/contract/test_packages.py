"""The packages in pyproject.toml are the packages that there are."""

from __future__ import annotations

import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[2]


def setuptools_table() -> dict:
    with (ROOT / "pyproject.toml").open("rb") as file:
        return tomllib.load(file)["tool"]["setuptools"]


def package_folders(folder: Path, name: str) -> set[str]:
    """Names of all packages from `folder`, which is package `name`, downwards."""
    found = {path.parent.relative_to(folder) for path in folder.rglob("__init__.py")}
    return {".".join([name, *relative.parts]) for relative in found}


def test_listed_packages_are_the_existing_ones():
    mapped = setuptools_table()["package-dir"]
    existing = set().union(*(package_folders(ROOT / folder, name) for name, folder in mapped.items()))
    assert set(setuptools_table()["packages"]) == existing


def test_only_hqpipe_is_installed_at_the_top():
    assert {name.partition(".")[0] for name in setuptools_table()["packages"]} == {"hqpipe"}


def test_data_files_exist():
    table = setuptools_table()
    for package, patterns in table["package-data"].items():
        folder = ROOT / table["package-dir"].get(package, package.replace(".", "/"))
        for pattern in patterns:
            assert list(folder.glob(pattern)), f"{package}: nothing matches {pattern}"


def test_template_of_init_is_shipped():
    assert "pipeline_template.yaml" in setuptools_table()["package-data"]["hqpipe.stages"]
