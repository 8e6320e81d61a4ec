"""The earlier record of a machine that `diagnose --reference` compares logs with."""

from __future__ import annotations

from typing import Any

REFERENCE = "reference"


def is_logs(context: Any) -> bool:
    """Whether there is a reference, and it is logs."""
    from hqpipe.actuators.files import FILE

    folder = context.inputs.get(REFERENCE)
    return folder is not None and not (folder / FILE).is_file()


def read_earlier(context: Any, most: int) -> Any:
    """The input `reference`: an `Earlier` of an actuator model, or `EarlierLogs`; None without it.

    Args:
        most: samples × joints of the reference's logs to read.

    Raises:
        UsageError: it is a model without coefficients.
        LogError: it is neither an actuator model nor logs.
    """
    from hqpipe.actuators.files import FILE
    from hqpipe.errors import LogError
    from hqpipe.gap.change.since import EarlierLogs, earlier_actuator
    from hqpipe.stages.inputs.logs import read_logs, shown_path

    folder = context.inputs.get(REFERENCE)
    if folder is None:
        return None
    if not is_logs(context):
        return earlier_actuator(folder, str(shown_path(context, folder)))
    try:
        return EarlierLogs(read_logs(context, most, REFERENCE))
    except LogError as error:
        raise LogError(f"--reference holds no {FILE}, so it was read as logs: {error}") from error
