"""What a cause is, in half a sentence, and what an engineer can do about it, in one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple, Protocol

from hqpipe.report.diagnosis_words import words


class Explained(Protocol):
    """An effect that says itself what it is and what can be done about it, as those of `hqpipe.machine` do."""

    meaning: str
    advice: str


class Words(NamedTuple):
    """The same of a cause that has no file of its own."""

    meaning: str
    advice: str


OTHERS = {
    "dead_time_asymmetry": Words(
        "one direction takes longer than the other to answer a command",
        "Look at the pilot stages and hoses of both directions; give each direction its own dead time in the "
        "simulator.",
    ),
    "opening_jump": Words(
        "at the edge of the deadband the flow sets in at once with a share of its full size",
        "Lower the driver's deadband compensation until the motion sets in gently, or keep the jump in the "
        "simulator: without it the policy will hunt round standstill.",
    ),
    "leakage": Words(
        "oil leaks past piston or spool, so that the joint creeps while its valve is closed",
        "Hold the joint under load with its valve closed and watch it sink: look at piston seals, spool and "
        "load-holding valves, and keep the creep in the simulator.",
    ),
    "counterbalance": Words(
        "a load-holding valve keeps a pulling load from speeding the motion up",
        "Keep the load out of the lowering speed in the simulator; a counterbalance, overcentre or load-holding "
        "valve does this on the machine.",
    ),
    "one_way_speed_limit": Words(
        "one direction does not exceed a certain speed, whatever the command",
        "Look for a counterbalance valve, a throttle with a check valve or a lowering brake in this direction, "
        "and put the limit in the simulator.",
    ),
    "armature": Words(
        "the drive's own inertia, seen at the joint",
        "Enter it as the joint's armature in the simulator; the link inertias of the URDF do not hold it.",
    ),
    "payload": Words(
        "a link carries mass that the model does not know",
        "Weigh what the link carries and enter it in the URDF; if it changes from run to run, vary it in training.",
    ),
    "inertia_error": Words(
        "a link's inertia differs from the model's",
        "Correct the link in the URDF, from CAD or from a pendulum test of the dismounted link.",
    ),
    "com_error": Words(
        "a link's centre of mass differs from the model's",
        "Correct the link's centre of mass in the URDF: hang the link from two points, or hold it still at "
        "several angles.",
    ),
    "ground_friction": Words(
        "the feet slip at another friction coefficient",
        "Measure how much the foot resists pulling on this ground, and vary the coefficient round it in training.",
    ),
    "ground_compliance": Words(
        "the ground yields",
        "Simulate the ground with this stiffness, or record on a hard floor to judge the actuators alone.",
    ),
    "ground_slope": Words(
        "the ground is not level",
        "Level the floor or the inertial sensor before recording, or give the slope to the simulator.",
    ),
    "voltage_sag": Words(
        "the supply voltage gives way under load, so that the drive has less to give",
        "Log the supply voltage, use thicker leads or a stronger supply, and put the resistance in the simulator.",
    ),
    "torque_limit": Words(
        "beyond a certain torque the drive gives no more",
        "Put the limit in the simulator, and keep the commanded motion below it; look at the drive's current "
        "limit and supply.",
    ),
    "gain_error": Words(
        "the gain of the drive is not what is stated",
        "Read the gain from the drive's settings and state it in logset.yaml; use the one found here in the simulator.",
    ),
    "spring": Words(
        "a spring, or what acts like one, pulls the joint to a place",
        "Look for a counterweight, gas spring or cable that pulls, and put it in the simulator as a joint stiffness.",
    ),
    "mount_tilt": Words(
        "the base is not level, so that gravity pulls in another direction",
        "Level the base, or give its angle to the simulator.",
    ),
    "gain_change": Words(
        "the same command opens the valve for more or less oil than it did",
        "Look at the supply pressure first, then at the valve driver's gain and the valve's edges; train with the "
        "model of now.",
    ),
    "leakage_change": Words(
        "more or less oil leaks away than did",
        "Hold the joint under load and watch it sink: piston seals and the valve's lands leak with wear, and more "
        "so in hot oil; plan the repair, and train with the model of now.",
    ),
    "velocity_coupling_change": Words(
        "motion takes more or less torque away than it did",
        "Check the scales of encoder and torque sensor first, for area times stiffness does not wear; then the "
        "volume of oil between valve and cylinder.",
    ),
    "impact_change": Words(
        "impacts against the command are braked differently",
        "Look at relief and anti-cavitation valves; the coefficient acts only while an impact drives the torque "
        "against the command.",
    ),
    "stiffness_change": Words(
        "the oil and what encloses it have become stiffer or softer",
        "Bleed the air, and look at the oil's temperature, the hoses and their length; train with the model of now.",
    ),
}
"""Causes of the layers that look at the motion, the servo or the valve alone, and changes between two records."""
NO_ADVICE = "Retrain with the model that holds this effect, and record again to see what is left."


def explanation(cause: Mapping[str, Any], effects: Mapping[str, Explained]) -> Explained:
    """What is known of a cause of diagnosis.json; effects: name → those that say it themselves."""
    name = cause["effect"]
    return effects.get(name) or OTHERS.get(name) or Words(words(cause["layer"]), NO_ADVICE)
