"""The error of a layer that can judge none of the joints."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from hqpipe.errors import IdentificationError


def no_joint_judged(
    path: Path, means: str, left: Mapping[str, str], fix: str, field: str | None = None
) -> IdentificationError:
    """What to raise, with the reason of every joint.

    Args:
        path: of the log set. means: what the layer judges a joint by, as in "by its valve command". left: joint → reason.
    """
    reasons = "; ".join(f"{joint}: {reason}" for joint, reason in left.items())
    return IdentificationError(f"{path}: no joint can be judged {means} ({reasons})", file=path, field=field, fix=fix)
