"""The parameter ``plant`` of a stage: overrides of the reference plant, checked before anything runs."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import AfterValidator, ValidationInfo

from hqpipe.errors import ConfigError
from hqpipe.pipeline.config import ROBOT, FieldError


def _checked(raw: dict[str, Any], info: ValidationInfo) -> dict[str, Any]:
    """The overrides as they are; without the robot, whose joints and links they name, they are not checked."""
    folder = (info.context or {}).get(ROBOT)
    if not raw or folder is None:
        return raw
    from hqpipe.plant.config import PlantConfig
    from hqpipe.plant.parameters import check_overrides
    from hqpipe.robots import load_robot

    robot = load_robot(folder)
    try:
        check_overrides(PlantConfig(raw), robot)
    except ConfigError as error:
        if error.file is not None:
            raise
        problem = error.message.removeprefix(f"{error.field}: ")
        below = (error.field or "").removeprefix("plant").lstrip(".")
        raise FieldError(ConfigError(problem, field=below, fix=error.fix)) from None
    return raw


Plant = Annotated[dict[str, Any], AfterValidator(_checked)]
"""Overrides of `hqpipe.plant.PlantConfig`."""
