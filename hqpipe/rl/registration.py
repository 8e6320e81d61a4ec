"""Makes the environment known to Gymnasium."""

from __future__ import annotations

import gymnasium

ENVIRONMENT_ID = "hqpipe/HydraulicQuadruped-v0"


def register_environments() -> None:
    """Register ``hqpipe/HydraulicQuadruped-v0``; a second call changes nothing."""
    if ENVIRONMENT_ID not in gymnasium.registry:
        gymnasium.register(id=ENVIRONMENT_ID, entry_point="hqpipe.rl.env:LocomotionEnv")
