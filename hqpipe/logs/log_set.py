"""Reading a directory of trials."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from hqpipe.errors import LogError, near_match
from hqpipe.logs import FORMAT, LOG_READERS
from hqpipe.logs.checks import check_length
from hqpipe.logs.clocks import SAME_RATE
from hqpipe.logs.columns import Shape, check_names, joint_column, joints_of
from hqpipe.logs.differentiate import window_s
from hqpipe.logs.findings import Finding, grouped
from hqpipe.logs.joint_kinds import completed
from hqpipe.logs.long_logs import coverage, joined, plan, read_sections
from hqpipe.logs.manifest import COMMAND_OF, FILE, SPLITS, Manifest, read_manifest
from hqpipe.logs.overlap import check_apart
from hqpipe.logs.same_files import check_copies, check_distinct, digests_of
from hqpipe.logs.size import check_size
from hqpipe.logs.split import split_of
from hqpipe.logs.trajectory import LogSet, Trajectory, Trial, recording_of
from hqpipe.logs.units import unit_findings
from hqpipe.logs.whole_logs import Logs, read_whole
from hqpipe.logs.wiring import wiring_findings


def read_log_set(
    path: str | Path, *, strict: bool = False, most: int | None = None, all_heldout: bool = False
) -> LogSet:
    """Read a log set; with no logset.yaml, everything is inferred and the warnings say how.

    Missing samples count for nothing, a clock that jitters is brought to a uniform one, trials of another rate to that of the
    others; a channel that is mostly missing is left out, with its joint or trial if they are nothing without it. The warnings
    say so, a line for each kind.

    Args:
        path: directory with one file per trial.
        strict: refuse what would have to be repaired.
        most: samples × joints to keep in memory; of a longer log set evenly spaced sections are read, each a trial of
            its own, and a warning says so. None for everything.
        all_heldout: hold every trial out, whatever logset.yaml says: models are judged on such a set and none is fitted to it.

    Raises:
        LogError: the directory or a file in it cannot be used.
    """
    folder = Path(path)
    readers = _readers_by_suffix()
    files = _trial_files(folder, readers)
    manifest = _manifest(folder, files, needs_fit=not all_heldout)
    used = [entry.file for entry in manifest.trials] if manifest else files
    outlines = _outlines(folder, readers, used)
    check_distinct(folder, used)
    splits = {} if all_heldout else split_of(manifest, used)
    digests = digests_of(folder, used)
    copies = check_copies(folder, digests, splits)
    mode = _control_mode(folder, manifest, next(iter(outlines.values())))
    options = {
        "command": COMMAND_OF[mode] if mode else None,
        "stated_hz": manifest.rate_hz if manifest else None,
        "strict": strict,
    }
    thinned = plan(folder, readers, manifest, outlines, most) if most else None
    if thinned:
        logs = read_sections(folder, readers, thinned, splits, manifest, **options)
    else:
        check_size(folder, outlines.values())
        logs = read_whole(folder, readers, used, splits, manifest, all_heldout=all_heldout, **options)
    trials = _same_joints(folder, logs.trials)
    if all_heldout:
        trials = [replace(trial, split="heldout") for trial in trials]
    elif not any(trial.split == "fit" for trial in trials):
        raise _nothing_to_fit(folder, logs)
    repeats = check_apart(*([logs.prints[f] for f, split in splits.items() if split == name] for name in SPLITS))
    recorded = joined(trials)
    named = list({trial.file: (trial.file, trial.trajectory) for trial in recorded}.values())
    first = named[0][1]
    findings = _findings(manifest, named, recorded)
    warnings = [
        *([coverage(thinned)] if thinned else []),
        *(repair.text for repair in logs.repairs),
        *_warnings(manifest, files, first, recorded),
        *grouped(findings, [file for file, _ in named]),
        *copies,
        *repeats,
    ]
    return LogSet(
        path=folder,
        sha256=_digest(folder, digests),
        format=FORMAT,
        robot=manifest.robot if manifest else None,
        base=manifest.base if manifest else None,
        control_mode=mode,
        effort_source=manifest.effort_source if manifest else None,
        rate_hz=_rate(manifest, first.dt),
        joints=first.joints,
        trials=tuple(trials),
        warnings=tuple(warnings),
        kinds=_kinds(folder, manifest, joints_of(next(iter(outlines.values())).names), first.joints),
        findings=tuple(findings),
        repairs=tuple(logs.repairs),
        as_recorded=logs.as_recorded,
    )


def _rate(manifest: Manifest | None, dt: float) -> float:
    """The nominal rate where it agrees with the clocks, else theirs, Hz."""
    stated = manifest.rate_hz if manifest else None
    return stated if stated and abs(stated * dt - 1.0) <= SAME_RATE else float(f"{1.0 / dt:.4g}")


def _nothing_to_fit(folder: Path, logs: Logs) -> LogError:
    reasons = "; ".join(repair.text for repair in logs.repairs if repair.kind in ("trial", "missing"))
    return LogError(
        f"{folder}: no trial with split: fit is left ({reasons})",
        file=folder,
        field="trials",
        fix="record one that is whole, or give another one split: fit",
    )


def _manifest(folder: Path, files: list[str], *, needs_fit: bool) -> Manifest | None:
    path = folder / FILE
    return read_manifest(path, files, needs_fit=needs_fit) if path.exists() or path.is_symlink() else None


def _kinds(folder: Path, manifest: Manifest | None, recorded: Sequence[str], joints: Sequence[str]) -> dict[str, str]:
    """Joint → revolute or prismatic, as far as logset.yaml says it, of the `joints` that are left of those `recorded`."""
    kinds = manifest.kinds if manifest else {}
    for name in kinds:
        if name not in recorded:
            raise LogError(
                f"{folder / FILE}: joints: no joint '{name[:99]}'{near_match(name[:99], recorded)} (has {', '.join(recorded)})",
                file=folder / FILE,
                field="joints",
                fix="name joints of the trials",
            )
    return completed({name: kind for name, kind in kinds.items() if name in joints}, joints)


def _outlines(folder: Path, readers: dict[str, type], used: list[str]) -> dict[str, Shape]:
    """Columns and rows of every file; none has been decoded yet."""
    found = {}
    for file in used:
        suffix = Path(file).suffix
        if suffix not in readers:
            raise LogError(
                f"{folder / file}: no reader for '{suffix}' (known: {', '.join(readers)})",
                file=folder / file,
                fix=f"convert it to {next(iter(readers))}",
            )
        found[file] = readers[suffix].outline(folder / file)
        check_names(found[file].empty())
        check_length(folder / file, found[file].rows)
    return found


def _readers_by_suffix() -> dict[str, type]:
    return {suffix: reader for reader in LOG_READERS.values() for suffix in reader.suffixes}


def _trial_files(folder: Path, readers: dict[str, type]) -> list[str]:
    """Names of what looks like a trial, by its ending; whether it is a file is checked when it is opened."""
    if not folder.is_dir():
        what = "is a file" if folder.is_file() else "does not exist"
        siblings = [p.name for p in folder.parent.glob("*")] if folder.parent.is_dir() else []
        hint = "" if folder.is_file() else near_match(folder.name, siblings)
        raise LogError(
            f"{folder} {what}{hint}; expected a directory with one file per trial",
            file=folder,
            fix="name the folder that the trials lie in",
        )
    try:
        present = sorted(folder.iterdir())
    except OSError as error:
        fix = "give yourself the right to read it"
        raise LogError(f"{folder}: cannot be listed ({error.strerror})", file=folder, fix=fix) from error
    files = [p.name for p in present if p.suffix in readers]
    if not files and not (folder / FILE).is_file():
        others = sorted({p.suffix or p.name for p in present})
        found = f"found only {', '.join(others[:6])}" if others else "it is empty"
        raise LogError(
            f"{folder}: no trial in it ({found}); expected {' or '.join(readers)} files, one per trial",
            file=folder,
            fix="write them as docs/how-to/bring-your-own-logs.md shows",
        )
    return files


def _same_joints(folder: Path, trials: list[Trial]) -> list[Trial]:
    """Bring every trial to the joint order of the first one.

    Raises:
        LogError: a trial lacks a joint or a channel.
    """
    first = trials[0]
    same = []
    for trial in trials:
        for a, b in ((first, trial), (trial, first)):
            path = folder / recording_of(b)
            if odd := [j for j in a.trajectory.joints if j not in b.trajectory.joints]:
                raise LogError(
                    f"{path}: no joint '{odd[0]}'{near_match(odd[0], b.trajectory.joints)}, which {recording_of(a)} has; "
                    "expected the same joints in every trial",
                    file=path,
                    field=joint_column(odd[0], "position"),
                    fix="rename the columns of the joint, or make a log set of its own for each machine",
                )
            if lacking := [c for c in a.trajectory.channels() if c not in b.trajectory.channels()]:
                column = joint_column(a.trajectory.joints[0], lacking[0])
                raise LogError(
                    f"{path}: no column '{column}', which {recording_of(a)} has; expected the same channels in every trial",
                    file=path,
                    field=column,
                    fix="record it in every trial, or drop it from all",
                )
        order = first.trajectory.joints
        t = trial.trajectory
        same.append(trial if t.joints == order else replace(trial, trajectory=t.for_joints(order)))
    return same


def _control_mode(folder: Path, manifest: Manifest | None, first: Shape) -> str | None:
    joints = joints_of(first.names)
    recorded = [m for m, channel in COMMAND_OF.items() if joint_column(joints[0], channel) in first.names]
    if manifest is None or manifest.control_mode is None:
        return recorded[0] if recorded else None
    channel = COMMAND_OF[manifest.control_mode]
    if manifest.control_mode not in recorded:
        raise LogError(
            f"{folder / FILE}: control_mode is {manifest.control_mode}, but the trials have no column "
            f"'{joint_column(joints[0], channel)}'",
            file=folder / FILE,
            field="control_mode",
            fix="record it, or leave control_mode out",
        )
    return manifest.control_mode


def _digest(folder: Path, digests: Mapping[str, bytes]) -> str:
    """Of the names and bytes of all files that were read."""
    if (folder / FILE).is_file():
        digests = {**digests, **digests_of(folder, [FILE])}
    total = hashlib.sha256()
    for file in sorted(digests):
        total.update(file.encode() + b"\0" + digests[file])
    return total.hexdigest()


def _warnings(manifest: Manifest | None, files: list[str], first: Trajectory, trials: list[Trial]) -> list[str]:
    """How the set was read."""
    found = []
    if manifest is None:
        held = ", ".join(f"{t.file} ({t.trajectory.whole:.1f} s)" for t in trials if t.split == "heldout")
        found.append(f"no {FILE}: joints, mode and rate come from the columns; held out: {held}")
    else:
        used = {entry.file for entry in manifest.trials}
        if unused := [file for file in files if file not in used]:
            found.append(f"{FILE} does not list {', '.join(unused)}: not read")
        if not any(t.split == "heldout" for t in trials):
            found.append(f"{FILE} holds out no trial: no error can be stated on data that the fit has not seen")
    if first.velocity_source == "differentiated":
        span = 1e3 * window_s(first.dt)
        found.append(f"no velocity recorded: differentiated from position, zero-phase, window {span:.0f} ms")
    return found


def _findings(manifest: Manifest | None, named: list[tuple[str, Trajectory]], trials: list[Trial]) -> list[Finding]:
    """What looks wrong in single trials."""
    rate = manifest.rate_hz if manifest else None
    units = [finding for file, trial in named for finding in unit_findings(file, trial, rate)]
    return units + wiring_findings(trials)
