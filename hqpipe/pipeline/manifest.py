"""The record beside every artifact: what made it, from what, and the hash of every file."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, fields
from pathlib import Path, PurePosixPath
from typing import Any

from hqpipe.errors import IntegrityError
from hqpipe.pipeline.hashing import SHORT, data_hash

MANIFEST = "manifest.json"
FORMAT = "hqpipe-artifact/1"


@dataclass(frozen=True)
class Recipe:
    """Everything that decides what a stage produces; its hash is the artifact's key.

    Args:
        stage: name of the stage.
        version: code version of the stage.
        params: resolved parameters, plain data.
        seed: seed of the random numbers.
        inputs: input name → content hash.
        robot: hash of the robot folder.
    """

    stage: str
    version: int
    params: dict[str, Any]
    seed: int
    inputs: dict[str, str]
    robot: str

    @property
    def key(self) -> str:
        return data_hash(asdict(self))


@dataclass(frozen=True)
class Manifest:
    """A committed artifact's record, as written to ``manifest.json``.

    Args:
        recipe: what decided the content.
        sources: input name → {"artifact": name or None, "key": key or None, "path": folder as it was given}.
        outputs: relative path → SHA-256 of each file.
        metrics: what the stage returned.
        provenance: versions, git commit, machine, command line, wall time: told, but not part of the key.
    """

    recipe: Recipe
    sources: dict[str, dict[str, str | None]]
    outputs: dict[str, str]
    metrics: dict[str, Any]
    provenance: dict[str, Any]

    @property
    def key(self) -> str:
        return self.recipe.key

    @property
    def content(self) -> str:
        """Hash over the outputs alone: the same bytes made in another way have the same one."""
        return data_hash(self.outputs)

    @property
    def gate_failures(self) -> list[str]:
        """Thresholds that this artifact missed; empty when it has no gate or passed."""
        gate = self.metrics.get("gate")
        if gate is None or gate["passed"]:
            return []
        return list(gate["failures"]) or ["no threshold was named"]

    def to_json(self) -> dict[str, Any]:
        """Plain data with the format, the key, the content hash and a digest of the whole record."""
        body = {"format": FORMAT, "key": self.key, "outputs_sha256": self.content, **asdict(self)}
        return {**body, "digest": data_hash(body)}

    def write(self, folder: Path) -> None:
        """Write ``manifest.json`` into `folder`."""
        text = json.dumps(self.to_json(), indent=1, ensure_ascii=False, allow_nan=False)
        (folder / MANIFEST).write_text(text + "\n", encoding="utf-8")


def is_artifact(folder: Path) -> bool:
    """Whether `folder` holds a ``manifest.json`` of ours (intact or not)."""
    try:
        return FORMAT in (folder / MANIFEST).read_text(encoding="utf-8")
    except (FileNotFoundError, UnicodeDecodeError):
        return False


def read_manifest(folder: Path) -> Manifest:
    """Read and check ``manifest.json`` of `folder`.

    Raises:
        IntegrityError: it is missing, unreadable, of another format, or was changed after it was written.
    """
    path = folder / MANIFEST
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        digest = data.pop("digest")
        stated = data.pop("format")
    except FileNotFoundError:
        raise IntegrityError(f"{path} is missing") from None
    except (ValueError, KeyError, AttributeError, TypeError) as error:
        raise IntegrityError(f"{path} is not a manifest (expected JSON with 'format' and 'digest')") from error
    if stated != FORMAT:
        raise IntegrityError(f"{path} has format {stated!r}, expected {FORMAT!r}")
    try:
        found = data_hash({"format": stated, **data})
        body = {field.name: data[field.name] for field in fields(Manifest)}
        manifest = Manifest(**{**body, "recipe": Recipe(**body["recipe"])})
    except (KeyError, TypeError, ValueError) as error:
        raise IntegrityError(f"{path} lacks a field of a manifest: {error}") from error
    if found != digest or manifest.key != data.get("key"):
        raise IntegrityError(f"{path} was changed: expected digest {str(digest)[:SHORT]}…, found {found[:SHORT]}…")
    _check_paths(path, manifest.outputs)
    return manifest


def _check_paths(path: Path, outputs: dict[str, str]) -> None:
    """Refuse output paths that would lead out of the artifact folder."""
    for name in outputs:
        pure = PurePosixPath(name)
        if pure.is_absolute() or ".." in pure.parts or name in ("", MANIFEST) or "\\" in name:
            raise IntegrityError(f"{path}: output path {name!r} leads out of the artifact folder")
