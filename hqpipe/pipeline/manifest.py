"""The record beside every artifact: what made it, from what, and the hash of every file."""

from __future__ import annotations

import json
import os
import re
import stat
from dataclasses import asdict, dataclass, fields
from pathlib import Path, PurePosixPath
from typing import Annotated, Any

from pydantic import AfterValidator, Strict, TypeAdapter, ValidationError

from hqpipe.errors import IntegrityError
from hqpipe.pipeline.hashing import SHORT, data_hash

MANIFEST = "manifest.json"
FORMAT = "hqpipe-artifact/1"
MAKE_AGAIN = "make the result again with --force, or remove its folder"

# Ours have less than ten levels; what reads a record must not run out of stack on one.
_MOST_LEVELS = 100

KEY = re.compile(r"[0-9a-f]{64}")
"""SHA-256 in hexadecimal digits."""


def _check_hash(text: str) -> str:
    if not KEY.fullmatch(text):
        raise ValueError("expected 64 hexadecimal digits")
    return text


Hash = Annotated[str, AfterValidator(_check_hash)]


def gate_has_form(gate: Any) -> bool:
    """Whether the metric `gate` is {passed: bool, failures: list of text}."""
    if not isinstance(gate, dict) or not isinstance(gate.get("failures"), list):
        return False
    return isinstance(gate.get("passed"), bool) and all(isinstance(failure, str) for failure in gate["failures"])


def _check_metrics(metrics: dict[str, Any]) -> dict[str, Any]:
    if metrics.get("gate") is not None and not gate_has_form(metrics["gate"]):
        raise ValueError("expected gate: {passed: bool, failures: list}")
    return metrics


def _check_provenance(provenance: dict[str, Any]) -> dict[str, Any]:
    for name, kind in (("created", str), ("profile", str), ("wall_time_s", int | float)):
        if not isinstance(provenance.get(name), kind):
            raise ValueError(f"expected {name}, {'text' if kind is str else 'a number'}")
    tasks = provenance.get("tasks", [])
    if not isinstance(tasks, list) or not all(isinstance(key, str) and KEY.fullmatch(key) for key in tasks):
        raise ValueError("expected tasks, a list of keys of 64 hexadecimal digits")
    return provenance


def _check_source(source: dict[str, Any]) -> dict[str, Any]:
    if source.keys() != {"artifact", "key", "path"}:
        raise ValueError("expected artifact, key and path")
    if source["artifact"] is None and source["path"] is None:
        raise ValueError("expected an artifact or a path")
    if source["key"] is not None and not KEY.fullmatch(source["key"]):
        raise ValueError("expected a key of 64 hexadecimal digits")
    return source


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
    version: Annotated[int, Strict()]
    params: dict[str, Any]
    seed: Annotated[int, Strict()]
    inputs: dict[str, Hash]
    robot: Hash

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
    sources: dict[str, Annotated[dict[str, str | None], AfterValidator(_check_source)]]
    outputs: dict[str, Hash]
    metrics: Annotated[dict[str, Any], AfterValidator(_check_metrics)]
    provenance: Annotated[dict[str, Any], AfterValidator(_check_provenance)]

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
    path = folder / MANIFEST
    try:
        return path.is_file() and FORMAT in path.read_text(encoding="utf-8")
    except (FileNotFoundError, UnicodeDecodeError):
        return False


def read_manifest(folder: Path) -> Manifest:
    """Read and check ``manifest.json`` of `folder`.

    Raises:
        IntegrityError: it is missing, unreadable, of another format, or was changed after it was written.
    """
    path = folder / MANIFEST
    try:
        data = json.loads(_read(path).decode())
        digest = data.pop("digest")
        stated = data.pop("format")
        if _levels(data) > _MOST_LEVELS:
            raise RecursionError
    except RecursionError:
        raise _damaged(path, f"{path} is nested more than {_MOST_LEVELS} levels deep") from None
    except (ValueError, KeyError, AttributeError, TypeError) as error:
        raise _damaged(path, f"{path} is not a manifest (expected JSON with 'format' and 'digest')") from error
    if stated != FORMAT:
        raise _damaged(path, f"{path} has format {str(stated)[:SHORT]!r}, expected {FORMAT!r}")
    manifest = _checked(path, data)
    try:
        found = data_hash({"format": stated, **data})
    except ValueError as error:
        raise _damaged(path, f"{path} is not a manifest: {error}") from error
    if found != digest or manifest.key != data.get("key"):
        raise _damaged(path, f"{path} was changed: expected digest {str(digest)[:SHORT]}…, found {found[:SHORT]}…")
    _check_paths(path, manifest.outputs)
    return manifest


def _read(path: Path) -> bytes:
    """The bytes of a regular file; a link is not followed, a pipe not waited for."""
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
    except (FileNotFoundError, NotADirectoryError):
        raise _damaged(path, f"{path} is missing") from None
    except OSError as error:
        raise _damaged(path, f"{path} cannot be read ({error.strerror}), expected a file") from error
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise _damaged(path, f"{path} is not a regular file")
    with open(descriptor, "rb") as file:
        return file.read()


def _checked(path: Path, data: dict[str, Any]) -> Manifest:
    """The record in `data`, every field of the expected kind."""
    try:
        manifest = _MANIFEST.validate_python({field.name: data[field.name] for field in fields(Manifest)})
    except KeyError as error:
        raise _damaged(path, f"{path} lacks a field of a manifest: {error}", str(error.args[0])) from error
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        name = ".".join(str(part) for part in first["loc"])
        wrong = str(first["ctx"]["error"]) if first["type"] == "value_error" else first["msg"]
        wrong = wrong.replace("Input should be ", "expected ")
        raise _damaged(path, f"{path}: {name}: {wrong}, got {str(first['input'])[:40]!r}", name) from None
    if strangers := manifest.sources.keys() - manifest.recipe.inputs.keys():
        name = f"sources.{min(strangers)}"
        raise _damaged(path, f"{path}: {name}: expected one of recipe.inputs", name)
    return manifest


def _levels(data: Any) -> int:
    """How deep mappings and lists are nested, without recursion."""
    depth, layer = 0, [data]
    while layer := [
        inner
        for value in layer
        if isinstance(value, dict | list)
        for inner in (value.values() if isinstance(value, dict) else value)
    ]:
        depth += 1
    return depth


def _check_paths(path: Path, outputs: dict[str, str]) -> None:
    """Refuse output paths that would lead out of the artifact folder."""
    for name in outputs:
        pure = PurePosixPath(name)
        if pure.is_absolute() or ".." in pure.parts or name in ("", MANIFEST) or "\\" in name or "\0" in name:
            raise _damaged(path, f"{path}: output path {name!r} leads out of the artifact folder", "outputs")


def _damaged(path: Path, message: str, field: str | None = None) -> IntegrityError:
    return IntegrityError(message, file=path, field=field, fix=MAKE_AGAIN)


_MANIFEST = TypeAdapter(Manifest)
