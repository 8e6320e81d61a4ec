"""Reading a directory of trials."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from hqpipe.errors import LogError, near_match
from hqpipe.logs import FORMAT, LOG_READERS
from hqpipe.logs.assemble import assemble
from hqpipe.logs.checks import check_length, jitter
from hqpipe.logs.columns import Shape, check_names, joint_column
from hqpipe.logs.differentiate import window_s
from hqpipe.logs.findings import Finding, grouped
from hqpipe.logs.long_logs import Plan, coverage, joined, plan, read_sections
from hqpipe.logs.manifest import FILE, SPLITS, Manifest, read_manifest
from hqpipe.logs.overlap import Fingerprint, check_apart, fingerprint, fingerprint_file
from hqpipe.logs.same_files import check_copies, check_distinct, digests_of
from hqpipe.logs.size import check_size
from hqpipe.logs.split import infer_split, split_of
from hqpipe.logs.trajectory import LogSet, Trajectory, Trial
from hqpipe.logs.units import unit_findings
from hqpipe.logs.wiring import wiring_findings

_COMMAND_OF = {"position": "position_command", "torque": "effort_command", "valve": "valve_command"}
_JITTER_WARNING = 0.05  # assumption: below 5 % of a sample the models do not notice


def read_log_set(
    path: str | Path, *, resample: bool = False, most: int | None = None, all_heldout: bool = False
) -> LogSet:
    """Read a log set; with no logset.yaml, everything is inferred and the warnings say how.

    Args:
        path: directory with one file per trial.
        resample: interpolate each trial onto a uniform clock.
        most: samples × joints to keep in memory; of a longer log set evenly spaced sections are read, each a trial of
            its own, and a warning says so. None for everything.
        all_heldout: hold every trial out, whatever logset.yaml says: models are judged on such a set and none is fitted to it.

    Raises:
        LogError: the directory or a file in it cannot be used as it is.
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
    thinned = plan(folder, readers, manifest, outlines, most) if most else None
    if thinned:
        trials = _thinned(folder, readers, thinned, manifest, resample)
        named = list({trial.file: (trial.file, trial.trajectory) for trial in joined(trials)}.values())
        prints = {file: fingerprint_file(readers, folder / file) for file in splits}
    else:
        check_size(folder, outlines.values())
        named, prints = _whole(folder, readers, used, resample, splits)
        trials = _split(manifest, named, all_heldout)
    repeats = check_apart(*([prints[f] for f, split in splits.items() if split == name] for name in SPLITS))
    if all_heldout:
        trials = [replace(trial, split="heldout") for trial in trials]
    judged = joined(trials) if thinned else trials
    first = named[0][1]
    warnings = [
        *([coverage(thinned)] if thinned else []),
        *_warnings(manifest, files, named, judged),
        *copies,
        *repeats,
    ]
    mode = _control_mode(folder, manifest, first)
    return LogSet(
        path=folder,
        sha256=_digest(folder, digests),
        format=FORMAT,
        robot=manifest.robot if manifest else None,
        base=manifest.base if manifest else None,
        control_mode=mode,
        effort_source=manifest.effort_source if manifest else None,
        rate_hz=manifest.rate_hz if manifest and manifest.rate_hz else float(f"{1.0 / first.dt:.4g}"),
        joints=first.joints,
        trials=tuple(trials),
        warnings=tuple(warnings),
    )


def _manifest(folder: Path, files: list[str], *, needs_fit: bool) -> Manifest | None:
    path = folder / FILE
    return read_manifest(path, files, needs_fit=needs_fit) if path.exists() or path.is_symlink() else None


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


def _whole(
    folder: Path, readers: dict[str, type], used: list[str], uniform: bool, splits: Mapping[str, str]
) -> tuple[list[tuple[str, Trajectory]], dict[str, Fingerprint]]:
    """Every trial, and the fingerprints of those that have a split, of their samples as recorded."""
    named, prints = [], {}
    for file in used:
        table = readers[Path(file).suffix].read(folder / file)
        named.append((file, assemble(table, uniform=uniform)))
        if file in splits:
            prints[file] = fingerprint(table)
    return _same_joints(folder, named), prints


def _split(manifest: Manifest | None, named: list[tuple[str, Trajectory]], all_heldout: bool) -> list[Trial]:
    if manifest is None and all_heldout:
        return [Trial(file, "heldout", None, trajectory) for file, trajectory in named]
    if manifest is None:
        return infer_split(named)
    return [
        Trial(e.file, e.split, e.command, t, e.base or manifest.base)
        for e, (_, t) in zip(manifest.trials, named, strict=True)
    ]


def _thinned(
    folder: Path, readers: dict[str, type], kept: Plan, manifest: Manifest | None, uniform: bool
) -> list[Trial]:
    trials = read_sections(folder, readers, kept, manifest.base if manifest else None, uniform=uniform)
    named = _same_joints(folder, [(trial.file, trial.trajectory) for trial in trials])
    return [replace(trial, trajectory=t) for trial, (_, t) in zip(trials, named, strict=True)]


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


def _same_joints(folder: Path, named: list[tuple[str, Trajectory]]) -> list[tuple[str, Trajectory]]:
    """Bring every trial to the joint order of the first one."""
    first_file, first = named[0]
    same = []
    for file, trial in named:
        for a, b, fa, fb in ((first, trial, first_file, file), (trial, first, file, first_file)):
            if odd := [j for j in a.joints if j not in b.joints]:
                raise LogError(
                    f"{folder / fb}: no joint '{odd[0]}'{near_match(odd[0], b.joints)}, which {fa} has; "
                    "expected the same joints in every trial",
                    file=folder / fb,
                    field=joint_column(odd[0], "position"),
                    fix="rename the columns of the joint, or make a log set of its own for each machine",
                )
            lacking = [c for c in a.channels() if c not in b.channels()]
            if lacking:
                column = joint_column(a.joints[0], lacking[0])
                raise LogError(
                    f"{folder / fb}: no column '{column}', which {fa} has; expected the same channels in every trial",
                    file=folder / fb,
                    field=column,
                    fix="record it in every trial, or drop it from all",
                )
        same.append((file, trial if trial.joints == first.joints else trial.for_joints(first.joints)))
    return same


def _control_mode(folder: Path, manifest: Manifest | None, first: Trajectory) -> str | None:
    recorded = [mode for mode, channel in _COMMAND_OF.items() if channel in first.channels()]
    if manifest is None or manifest.control_mode is None:
        return recorded[0] if recorded else None
    channel = _COMMAND_OF[manifest.control_mode]
    if manifest.control_mode not in recorded:
        raise LogError(
            f"{folder / FILE}: control_mode is {manifest.control_mode}, but the trials have no column "
            f"'{joint_column(first.joints[0], channel)}'",
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


def _warnings(
    manifest: Manifest | None, files: list[str], named: list[tuple[str, Trajectory]], trials: list[Trial]
) -> list[str]:
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
    first = named[0][1]
    if first.velocity_source == "differentiated":
        span = 1e3 * window_s(first.dt)
        found.append(f"no velocity recorded: differentiated from position, zero-phase, window {span:.0f} ms")
    looks: list[Finding] = []
    for file, trial in named:
        rms, _ = jitter(trial.time)
        if rms > _JITTER_WARNING:
            text = "the clock jitters by {} % of a sample; resample=true puts it on a uniform one"
            looks.append(Finding("jitter", file, text, size=100.0 * rms))
        looks += unit_findings(file, trial, manifest.rate_hz if manifest else None)
    looks += wiring_findings(trials)
    return [*found, *grouped(looks, [file for file, _ in named])]
