"""What a shell offers after Tab: stages, and the profiles of the project around the working directory."""

from __future__ import annotations

from pathlib import Path

import click

from hqpipe.errors import HqpipeError


def chain_stages(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[str]:
    """Names of the stages of ``run all``, for --from and --until."""
    return [name for name, stage in ctx.obj.items() if not stage.alone and name.startswith(incomplete)]


def profiles(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[str]:
    """Names under ``profiles`` in pipeline.yaml; none outside of a project, or where the file cannot be read."""
    from hqpipe.pipeline.config import FILE
    from hqpipe.pipeline.project import find_root
    from hqpipe.pipeline.yaml_source import read_yaml

    try:
        found = read_yaml(find_root(Path.cwd()) / FILE).data.get("profiles", {"default": {}})
    except HqpipeError:
        return []
    return [name for name in found if name.startswith(incomplete)] if isinstance(found, dict) else []
