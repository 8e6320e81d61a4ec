"""The layers of the gap: for each, which logs it can judge, its base model and the effects that may be its causes.

A layer is a class with

    NAME                                        as in diagnosis.json
    lacking(log_set) -> list[str]               columns or facts that it needs and the logs do not have; empty where it applies
    joints(log_set, window_s, without) -> LayerJoints    raises IdentificationError where no joint can be judged
"""

from __future__ import annotations

ONLY_IN_LAYERS = (
    *("armature", "counterbalance", "dead_time_asymmetry", "gain_error", "leakage", "one_way_speed_limit"),
    *("opening_jump", "payload", "spring", "torque_limit", "voltage_sag"),
)
"""Effects that a layer may offer and `hqpipe.machine` does not hold."""

LAYERS = {
    "actuator": "hqpipe.layers.actuator:Actuator",
    "servo": "hqpipe.layers.servo:Servo",
    "joint_motion": "hqpipe.layers.joint_motion:JointMotion",
    "valve": "hqpipe.layers.valve:Valve",
    "torque": "hqpipe.layers.torque:Torque",
}
