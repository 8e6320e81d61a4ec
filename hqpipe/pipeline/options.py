"""Command-line options that several commands share."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from hqpipe.pipeline.completion import profiles
from hqpipe.pipeline.names import path_problem

# NumPy and PyTorch both take seeds of 32 bits.
MAX_SEED = 2**32 - 1
# Each holds 200 MB, so that more is a slip of the hand.
MAX_WORKERS = 1024


class Folder(click.Path):
    """A folder on the command line, as `pathlib.Path`; a name that no file system takes is refused as such."""

    def __init__(self, exists: bool = False, file_okay: bool = True) -> None:
        super().__init__(exists=exists, file_okay=file_okay, path_type=Path)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if problem := path_problem(os.fspath(value)):
            self.fail(problem, param, ctx)
        return super().convert(value, param, ctx)


class Name(click.ParamType):
    """The name of an artifact, or where one lies."""

    name = "name"

    def convert(self, value: str, param: click.Parameter | None, ctx: click.Context | None) -> str:
        if problem := path_problem(value):
            self.fail(problem, param, ctx)
        return value


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
    text = "Profile of pipeline.yaml instead of its default."
    return click.Option(["--profile"], metavar="NAME", help=text, shell_complete=profiles)


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
