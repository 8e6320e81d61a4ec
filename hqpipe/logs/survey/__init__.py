"""What a log set holds and what it is good for, told without fitting a model.

`survey.survey.survey` returns a `Survey`; its `to_json` has these keys, which are stable:

path              the folder
verdict           "usable", "usable_with_findings", "not_diagnosable" (it can be read, but lacks what every layer of the
                  diagnosis needs) or "refused" (no command takes it as it is)
log_set           joints, control_mode, effort_source, rate_hz, base, robot, sha256; null where the set is refused
trials            per trial: file, split, seconds, samples, rate_hz, clock {verdict, jitter_rms, jitter_max, gaps}, lost (share
                  of the rows), stretches (into which it is cut), missing (share of the values), verdict ("ok", "jitter",
                  "gaps" or "refused"), error (of a refused file)
channels          per joint, channel and trial: joint, channel, file, unit, min, max, resolution (one step of the sensor), noise
                  (standard deviation), held_samples, limit (where it saturates), verdict ("ok", "empty",
                  "constant", "end stop", "saturated", "held" or "coarse") and flags (all of these that apply); null where it
                  cannot be told
excitation        per joint: joint, unit, travel, reversals, speed_rms, speed_95, rest_share, command, bandwidth_hz
layers            per layer of the diagnosis: layer, mode, possible, evaluated, missing (columns), note
other_columns     columns that belong to no channel of the format
findings, notes   text, files, joints; a note is no defect and does not count for --strict

Ranges, speeds and the like have the units of the log format; shares are 0 … 1, and jitter is a share of a sample.
"""
