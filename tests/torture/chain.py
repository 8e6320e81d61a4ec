"""The small project: all seven real stages in seconds. Made once for these sources, copied for every trial."""

from __future__ import annotations

import hashlib
import json
import shutil
import time
from dataclasses import dataclass
from pathlib import Path

from hqpipe.stages import STAGES

from .processes import ROOT, counted, hqpipe

CACHE = ROOT / "build" / "torture"
NAMES = tuple(stage.name for stage in STAGES.between(None, None))
ARTIFACTS = tuple(stage.artifact for stage in STAGES.between(None, None))
_KEPT_EFFECTS = ("command_delay", "coulomb_friction")  # two make a search, at a tenth of the time of all
_PIPELINE = """\
robot: hydraulic_quadruped
seed: 1
profile: micro
workers: 2
stages:
  bootstrap: {{}}
  collect: {{}}
  fit_actuator: {{}}
  diagnose: {{}}
  retrain: {{}}
  export: {{}}
  validate: {{}}
profiles:
  micro:
    bootstrap:
      position: &training
        total_steps: 384
        num_envs: 4
        checkpoint_interval: 1
        ppo: {{batch_size: 96, n_epochs: 1}}
        policy: {{hidden: [16]}}
        evaluation: {{num_envs: 1, interval: 1000, seconds: 0.5, commands: [[0.5, 0, 0]]}}
      torque: *training
    collect: {{walk_seconds: 2.0, gantry_seconds: 2.0, stress_seconds: 0.0, shortest_seconds: 1.0}}
    fit_actuator: {{rivals: [mlp], net_iterations: 2}}
    diagnose: {{without: [{without}]}}
    retrain: {{training: *training}}
    export: {{parity_samples: 8}}
    validate:
      {{scenarios: [stand], walk_seeds: 1, walk_seconds: 1.0, walk_falls: 1, torque_nrmse: 50.0, latency_us: 1.0e+6}}
"""


@dataclass(frozen=True)
class Chain:
    """The finished small project.

    Args:
        folder: never changed.
        seconds: stage → how long it takes, which is learned as it goes. operations: stage → how many file operations it made.
    """

    folder: Path
    seconds: dict[str, float]
    operations: dict[str, int]

    def copy(self, target: Path) -> Path:
        """A project of its own with the same bytes."""
        return Path(shutil.copytree(self.folder, target, symlinks=True, dirs_exist_ok=True))

    def outputs(self, artifact: str) -> dict[str, str]:
        return whole(self.folder, artifact)


def whole(project: Path, artifact: str) -> dict[str, str] | None:
    """Hashes that the artifact's record states, if every file has them; None if it is absent or not whole.

    Reads with its own code, so that a fault of hqpipe's own check does not hide itself.
    """
    folder = project / "artifacts" / artifact
    try:
        stated = json.loads((folder / "manifest.json").read_text())["outputs"]
        found = {name: hashlib.sha256((folder / name).read_bytes()).hexdigest() for name in stated}
    except (OSError, ValueError, KeyError):
        return None
    return stated if found == stated and stated else None


def forget_from(project: Path, stage: str) -> None:
    """Take away the results of `stage` and of those after it, as if they had never run."""
    for artifact in ARTIFACTS[NAMES.index(stage) :]:
        link = project / "artifacts" / artifact
        shutil.rmtree(link.resolve())
        link.unlink()


def small_chain() -> Chain:
    """The chain for these sources from the cache, or what is missing of it made now (a minute on an idle core)."""
    folder = CACHE / f"chain-{_sources()}"
    record = folder.with_suffix(".json")
    data = json.loads(record.read_text()) if record.is_file() else {"seconds": {}, "operations": {}}
    for name in NAMES[len(data["seconds"]) :]:
        seconds, operations = _make(folder, name)
        data["seconds"][name], data["operations"][name] = seconds, operations
        record.write_text(json.dumps(data))
    return Chain(folder, data["seconds"], data["operations"])


def _make(folder: Path, name: str) -> tuple[float, int]:
    """Run one stage; how long it took, and how many file operations it made."""
    from hqpipe.machine import EFFECTS

    folder.mkdir(parents=True, exist_ok=True)
    without = ", ".join(name for name in EFFECTS if name not in _KEPT_EFFECTS)
    (folder / "pipeline.yaml").write_text(_PIPELINE.format(without=without))
    count = folder.with_suffix(".count")
    started = time.monotonic()
    ended = hqpipe(folder, name, "--force", environment=counted(count))
    if ended.code != 0:
        raise RuntimeError(f"the small chain cannot be made: {name} ended with {ended.code}:\n{ended.err}")
    return time.monotonic() - started, int(count.read_text())


def _sources() -> str:
    """Hash of every source that the chain is made with."""
    digest = hashlib.sha256(_PIPELINE.encode())
    for place in ("hqpipe", "stages", "robot"):
        for path in sorted((ROOT / place).rglob("*")):
            if path.is_file() and "__pycache__" not in path.parts:
                digest.update(path.relative_to(ROOT).as_posix().encode() + path.read_bytes())
    return digest.hexdigest()[:12]
