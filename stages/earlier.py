"""The earlier record of a machine that `diagnose --reference` compares logs with."""

from __future__ import annotations

from typing import Any

REFERENCE = "reference"


def is_logs(context: Any) -> bool:
    """Whether there is a reference, and it is logs."""
    from hqpipe.actuators.files import FILE

    folder = context.inputs.get(REFERENCE)
    return folder is not None and not (folder / FILE).is_file()


def read_earlier(context: Any, log_set: Any, most: int) -> Any:
    """The `Earlier` of the input `reference`: an actuator model, or logs that are diagnosed first; None without it.

    Args:
        log_set: that will be compared with it; what does not fit is refused before the work begins.
        most: samples × joints of the reference's logs to read.

    Raises:
        UsageError: the reference and the logs do not fit together, or it is a model without coefficients.
        LogError: it is neither an actuator model nor logs.
    """
    from hqpipe.actuators.files import FILE
    from hqpipe.errors import LogError
    from hqpipe.gap.since import check_alike, earlier_actuator, sample_time
    from hqpipe.gap.since_logs import earlier_logs
    from hqpipe.stages.logs import read_logs, shown_path

    folder = context.inputs.get(REFERENCE)
    if folder is None:
        return None
    if not is_logs(context):
        return earlier_actuator(folder, str(shown_path(context, folder)))
    try:
        then = read_logs(context, most, REFERENCE)
    except LogError as error:
        raise LogError(f"--reference holds no {FILE}, so it was read as logs: {error}") from error
    check_alike(log_set, str(then.path), then.control_mode, then.joints, sample_time(then), then.effort_source)

    def progress(done: float, total: float, text: str) -> None:
        context.progress(0.5 * done, total, f"{REFERENCE}: {text}")

    return earlier_logs(then, context.params.window_s, context.params.without, context.workers, progress)
