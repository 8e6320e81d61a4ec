"""Everything that can be told of a log set without fitting a model."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from hqpipe.logs.columns import CHANNELS, joint_column
from hqpipe.logs.findings import groups_of
from hqpipe.logs.survey.channel import COMMANDS, ChannelVerdict, channel_verdicts
from hqpipe.logs.survey.clock import TrialVerdict, recordings, trial_verdict
from hqpipe.logs.survey.end_stop import EndStop, end_stops
from hqpipe.logs.survey.excitation import Excitation, excitations
from hqpipe.logs.survey.findings import Finding, grouped
from hqpipe.logs.survey.layers import COMMAND_OF, Layer, layers
from hqpipe.logs.survey.reading import Reading
from hqpipe.logs.trajectory import AsRecorded, Trajectory
from hqpipe.logs.vibration import MEANS, vibrations

USABLE, WITH_FINDINGS, NOT_DIAGNOSABLE, REFUSED = "usable", "usable_with_findings", "not_diagnosable", "refused"
_HEADER = ("joints", "control_mode", "effort_source", "rate_hz", "base", "robot", "sha256")


@dataclass(frozen=True, eq=False)
class Survey:
    """What a log set holds; the module's package says what the fields of its JSON are.

    Attributes:
        reading: what it was made from. trials: one per file and split, those that cannot be read among them.
        channels: one per joint, channel and trial. excitation: one per joint. layers: of the diagnosis.
        findings: defects and notes. other_columns: that belong to no channel of the format.
    """

    reading: Reading
    trials: tuple[TrialVerdict, ...]
    channels: tuple[ChannelVerdict, ...]
    excitation: tuple[Excitation, ...]
    layers: tuple[Layer, ...]
    findings: tuple[Finding, ...]
    other_columns: tuple[str, ...]

    @property
    def defects(self) -> list[Finding]:
        return [finding for finding in self.findings if not finding.is_note]

    @property
    def verdict(self) -> str:
        if self.reading.refused is not None:
            return REFUSED
        if not any(layer.evaluated for layer in self.layers):
            return NOT_DIAGNOSABLE
        return WITH_FINDINGS if self.defects else USABLE

    def to_json(self) -> dict[str, Any]:
        """Plain data, see `hqpipe.logs.survey`."""
        header = self.reading.log_set.header() if self.reading.log_set else None
        return {
            "path": str(self.reading.folder),
            "verdict": self.verdict,
            "log_set": header and {key: header[key] for key in _HEADER},
            "trials": [_trial_json(trial) for trial in self.trials],
            "channels": [_channel_json(channel) for channel in self.channels],
            "excitation": [{"joint": e.joint, "unit": CHANNELS["position"], **asdict(e)} for e in self.excitation],
            "layers": [asdict(layer) | {"missing": list(layer.missing)} for layer in self.layers],
            "other_columns": list(self.other_columns),
            "findings": [_finding_json(finding) for finding in self.findings if not finding.is_note],
            "notes": [_finding_json(finding) for finding in self.findings if finding.is_note],
        }


def survey(reading: Reading, more_warnings: Iterable[str] = ()) -> Survey:
    """Look a log set through.

    Args:
        reading: of the log set. more_warnings: of other checks, in the form of `LogSet.warnings`.
    """
    parts = recordings(reading.trials)
    trials = [trial_verdict(file, split, each, _before(reading, file)) for (file, split), each in parts.items()]
    channels = [verdict for (file, _), each in parts.items() for verdict in channel_verdicts(file, each)]
    alike = _with_same_joints([(file, part) for (file, _), each in parts.items() for part in each])
    stops = end_stops(alike)
    mode_channel = COMMAND_OF.get(_mode(reading) or "")
    found = excitations([part for _, part in alike], mode_channel) if alike else []
    possible = _layers(reading)
    own = [*_own_findings(channels, found, stops), *_vibrating(alike), *_undiagnosed(possible, _mode(reading))]
    files = list(dict.fromkeys(trial.file for trial in trials))
    said = [Finding(group.of_first, group.files, group.joints) for group in groups_of(reading.looks)]
    said += grouped([*reading.warnings, *more_warnings], files)
    for file, error in reading.errors.items():
        trials.append(TrialVerdict(file, "", verdict="refused", error=str(error)))
    return Survey(
        reading=reading,
        trials=tuple(trials),
        channels=tuple(_marked(channels, stops)),
        excitation=tuple(found),
        layers=tuple(possible),
        findings=tuple(sorted((*said, *own), key=lambda f: f.is_note)),
        other_columns=tuple(sorted({name for trial in reading.trials for name in trial.trajectory.extra})),
    )


def _before(reading: Reading, file: str) -> list[AsRecorded]:
    """A file, or its sections, before their repair."""
    own = reading.as_recorded.get(file)
    return [own] if own else [each for name, each in reading.as_recorded.items() if name.startswith(f"{file} (")]


def _with_same_joints(trials: Sequence[tuple[str, Trajectory]]) -> list[tuple[str, Trajectory]]:
    """The trials that have the joints of the first one; the others are named by the error of the set."""
    return [(file, t) for file, t in trials if t.joints == trials[0][1].joints]


def _mode(reading: Reading) -> str | None:
    """The control mode, inferred from the first trial where the set is refused and does not say it."""
    recorded = reading.trials[0].trajectory.channels() if reading.trials else {}
    return reading.control_mode or next((mode for mode, name in COMMAND_OF.items() if name in recorded), None)


def _layers(reading: Reading) -> list[Layer]:
    if not reading.trials:
        return []
    recorded = [trial.trajectory.channels() for trial in reading.trials]
    shared = [name for name in recorded[0] if all(name in each for each in recorded)]
    extra = [set(trial.trajectory.extra) for trial in reading.trials]
    bases = {trial.base or (reading.log_set.base if reading.log_set else None) for trial in reading.trials}
    return layers(
        shared,
        _mode(reading),
        reading.trials[0].trajectory.velocity_source != "measured",
        extra=set.intersection(*extra),
        base="floating" if "floating" in bases else "fixed" if bases == {"fixed"} else None,
        effort_source=reading.log_set.effort_source if reading.log_set else None,
    )


def _marked(channels: Sequence[ChannelVerdict], stops: Sequence[EndStop]) -> list[ChannelVerdict]:
    """The verdicts with those of joints at an end stop."""
    at_stop = {(stop.joint, file) for stop in stops for file in stop.files}
    return [c.at_end_stop() if c.channel == "position" and (c.joint, c.file) in at_stop else c for c in channels]


def _own_findings(
    channels: Sequence[ChannelVerdict], motion: Sequence[Excitation], stops: Sequence[EndStop]
) -> list[Finding]:
    found = [
        Finding(
            f"{joint_column(stop.joint, 'position')} stands at {stop.position:.4g} while its command goes {stop.beyond:.3g} "
            "beyond: an end stop? What the joint does there says nothing about its actuator",
            stop.files,
            (stop.joint,),
        )
        for stop in stops
    ]
    found += _held(channels)
    if still := [e.joint for e in motion if _still(e, channels)]:
        text = f"{joint_column(still[0], 'position')} does not move beyond its noise: nothing of the joint can be identified"
        found.append(Finding(text, (), tuple(still)))
    one_way = [e.joint for e in motion if e.reversals == 0 and e.joint not in still]
    if one_way:
        text = f"{joint_column(one_way[0], 'position')} moves one way only: friction and backlash cannot be told from an offset"
        found.append(Finding(text, (), tuple(one_way)))
    return found


def _vibrating(trials: Sequence[tuple[str, Trajectory]]) -> list[Finding]:
    return [
        Finding(
            f"{joint_column(each.joint, 'effort')}: {each.text(CHANNELS['effort'])}; {MEANS}",
            (),
            (each.joint,),
            is_note=True,
        )
        for each in vibrations([trajectory for _, trajectory in trials])
    ]


def _undiagnosed(possible: Sequence[Layer], mode: str | None) -> list[Finding]:
    """That no cause can be sought, where no layer with effects can be evaluated."""
    actuator = {layer.mode: layer for layer in possible if layer.mode is not None}
    if not actuator or any(layer.evaluated for layer in possible if layer.layer != "sensing"):
        return []
    missing = actuator[mode or "position"].missing
    text = (
        f"hqpipe diagnose names no cause in these logs: the actuator layer needs {' and '.join(missing)}; either of torque and "
        "command would do for another layer"
    )
    return [Finding(text)]


def _held(channels: Sequence[ChannelVerdict]) -> list[Finding]:
    """Channels whose source is slower than the clock: of a command a note, for that is how the controller works."""
    found = []
    for name in dict.fromkeys(c.channel for c in channels):
        slow = [c for c in channels if c.channel == name and c.held_samples is not None]
        if not slow:
            continue
        joints = tuple(dict.fromkeys(c.joint for c in slow))
        files = tuple(dict.fromkeys(c.file for c in slow))
        low, high = min(c.held_samples for c in slow), max(c.held_samples for c in slow)
        size = f"{low}" if low == high else f"{low} to {high}"
        text = f"{joint_column(joints[0], name)} is a staircase: it keeps each value for {size} samples"
        if name not in COMMANDS:
            text += ", so that it was recorded at a lower rate than the clock says"
        found.append(Finding(text, files, joints, is_note=name in COMMANDS))
    return found


def _still(motion: Excitation, channels: Sequence[ChannelVerdict]) -> bool:
    """Whether the travel is no more than noise and a few steps of the sensor."""
    own = [c for c in channels if c.joint == motion.joint and c.channel == "position" and "constant" not in c.flags]
    level = max((max(10.0 * (c.noise or 0.0), 3.0 * (c.resolution or 0.0)) for c in own), default=np.inf)
    return bool(own) and motion.travel <= level


def _trial_json(trial: TrialVerdict) -> dict[str, Any]:
    plain = asdict(trial)
    clock = {"verdict": trial.clock or None} | {key: plain.pop(key) for key in ("jitter_rms", "jitter_max", "gaps")}
    return {**plain, "split": trial.split or None, "clock": clock}


def _channel_json(channel: ChannelVerdict) -> dict[str, Any]:
    plain = asdict(channel)
    return plain | {
        "min": plain.pop("low"),
        "max": plain.pop("high"),
        "verdict": channel.verdict,
        "flags": list(channel.flags),
    }


def _finding_json(finding: Finding) -> dict[str, Any]:
    return {"text": finding.text, "files": list(finding.files), "joints": list(finding.joints)}
