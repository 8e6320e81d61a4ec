"""Signals of the chain by name, in the order in which they come about, and what each is where no block writes it."""

from __future__ import annotations

INPUTS = ("raw_command", "raw_position", "command", "position", "velocity", "sliding", "time", "demand")
"""Of a log or a simulator: command and position as they were logged, then as the chain takes them (rad), speed of the joint in
the hydraulics and in the friction (rad/s), time since the start of the trial (s), and flow that all joints draw from the supply
(counted in rad/s)."""

NEUTRAL: dict[str, float | str] = {
    "error": 0.0,  # of the position, rad: command less position
    "opening": "error",  # of the valve, in the unit of the command
    "loss": 0.0,  # of supply pressure, relative
    "mean": 0.0,  # what the mean pressure of the chambers is off by from half the supply, relative to that
    "lean": 0.0,  # share by which the chamber that an opening above 0 feeds is the stiffer one
    "even": 0.0,  # torque at which nothing leaks from one chamber to the other, N·m
    "oil": 0.0,  # stiffness of the oil, N·m/rad; 0 for a drive without any
    "half": 0.0,  # torque that takes up half of a chain's slack, N·m
    "passed": 1.0,  # flow per opening, relative to an unloaded valve at full supply
    "leak": 0.0,  # share of the torque that leaks away within a sample
    "arm": 1.0,  # moment arm, relative to that in the middle of the motion
    "speed": "velocity",  # as the oil feels it, rad/s
    "stiff": 1.0,  # relative stiffness, which multiplies the change of torque
    "wound": 0.0,  # torque of the hydraulics on a tight chain, N·m: the state of the base model
    "inner": "wound",  # torque that the chain passes on, N·m
    "effort": "wound",  # torque that the hydraulics feel, N·m
    "grip": 0.0,  # most that dry friction can hold, N·m
    "turned": 0.0,  # direction of dry friction, −1 … 1
    "strain": 0.0,  # by how much the travel of a sample turns it while the piston sticks
    "slow": 0.0,  # share of static friction at the present speed
    "lost": 0.0,  # torque lost between hydraulics and load cell, N·m
    "measured": 0.0,  # torque at the load cell, N·m: effort less lost
}
"""Signal → a number, or the signal that it is the same as.

A block behind the hydraulics says how it is undone where logs are to be unwound through it:

- of `measured`, the value in front of it;
- of `lost`, the torque `inner` in front of all friction from the one behind it (a law that does not read `inner` needs none);
- of `effort`, the torque `wound` that leaves `behind` while `lost` is lost, where `expected` is what the model expected.
"""

FEEDBACK = ("wound", "inner", "effort", "before")
"""What only a running model knows; `before` is `wound` one sample ago."""
BEHIND = ("inner", "grip", "turned", "lost", "effort", "measured")
"""What comes about behind the base model, in this order."""
