"""The search over the joints of a layer."""

from __future__ import annotations

from collections.abc import Callable

from hqpipe.identify.found import LayerFound
from hqpipe.identify.model import LayerJoints

Progress = Callable[[float, float, str], None]


def identify(
    joints: LayerJoints, *, workers: int = 1, progress: Progress | None = None, reference: LayerJoints | None = None
) -> LayerFound:
    """Find the effects of every joint.

    Args:
        joints: of one layer. workers: joints at a time; the answer does not depend on it. progress: called with (done, total, text).
        reference: the same joints in an earlier record of the machine; then causes are what changed since.
    """
    raise NotImplementedError
