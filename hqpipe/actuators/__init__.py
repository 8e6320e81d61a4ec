"""Actuator models: what turns a joint target into joint torque. One model per file."""

from __future__ import annotations

from hqpipe.registry import Registry

ACTUATOR_MODELS = Registry(
    "actuator model",
    {
        "ideal_torque": "hqpipe.actuators.ideal_torque:IdealTorque",
        "stiff_pd": "hqpipe.actuators.stiff_pd:StiffPD",
        "hydraulic": "hqpipe.actuators.hydraulic:Hydraulic",
        "two_chamber": "hqpipe.actuators.two_chamber:TwoChamber",
        "augmented": "hqpipe.actuators.augmented:Augmented",
        "mlp": "hqpipe.actuators.mlp:MLP",
        "lstm": "hqpipe.actuators.lstm:LSTM",
        "gru": "hqpipe.actuators.gru:GRU",
    },
)
