"""Command-line options that several commands share."""

from __future__ import annotations

import os
from collections.abc import Callable

import click

# NumPy and PyTorch both take seeds of 32 bits.
MAX_SEED = 2**32 - 1


def _show_traceback(ctx: click.Context, param: click.Parameter, value: bool) -> None:
    if value:
        os.environ["HQPIPE_TRACEBACK"] = "1"


def traceback_option() -> click.Option:
    """``--traceback``, for the group and for the commands that run stages."""
    return click.Option(
        ["--traceback"],
        is_flag=True,
        expose_value=False,
        callback=_show_traceback,
        help="Show where an error came from (also: HQPIPE_TRACEBACK=1).",
    )


def json_option() -> click.Option:
    return click.Option(["--json", "as_json"], is_flag=True, help="Answer in JSON on standard output.")


def profile_option() -> click.Option:
    return click.Option(["--profile"], metavar="NAME", help="Profile of pipeline.yaml instead of its default.")


def explain_option() -> click.Option:
    return click.Option(["--explain"], is_flag=True, help="Say for each stage everything that changed.")


def running_options(form: str) -> list[click.Option]:
    """The options of every command that runs stages; `form` is what ``--set`` takes."""
    return [
        profile_option(),
        click.Option(["--set", "overrides"], multiple=True, metavar=form, help="Change a parameter; repeatable."),
        click.Option(["--seed"], type=click.IntRange(0, MAX_SEED), help="Seed instead of pipeline.yaml's."),
        click.Option(["--force"], is_flag=True, help="Run from the start even if nothing changed."),
        click.Option(["--dry-run"], is_flag=True, help="Say what would run and why; change nothing."),
        explain_option(),
        json_option(),
        traceback_option(),
    ]


def with_options(*options: click.Option) -> Callable[[click.Command], click.Command]:
    """Add ready-made options to a command."""

    def add(command: click.Command) -> click.Command:
        command.params.extend(options)
        return command

    return add
