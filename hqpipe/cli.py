"""The ``hqpipe`` command: names and help from literal tables, everything else imported when it is invoked."""

from __future__ import annotations

import os
import re
import sys
import traceback
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NoReturn

import click

from hqpipe import __version__
from hqpipe.errors import HqpipeError, UsageError, near_match
from hqpipe.pipeline.options import traceback_option
from hqpipe.pipeline.stage import StageTable
from hqpipe.pipeline.streams import ReaderGone, prepare_streams
from hqpipe.registry import load
from hqpipe.system.failures import system_failure
from hqpipe.system.signals import MESSAGE, REMEDY, STATE, Interrupted, end, ignore_signals, raise_on_signals

HELP = "Close the sim-to-real gap of heavy hydraulic legged robots: collect, fit, diagnose, retrain, export, validate."

COMMANDS = {
    "run": ("hqpipe.pipeline.run_commands:run", "Run the whole chain, or a part of it."),
    "status": (
        "hqpipe.pipeline.query_commands:status",
        "Say which artifacts are current.",
    ),
    "dag": ("hqpipe.pipeline.query_commands:dag", "Show the stages and what they read and write."),
    "verify": ("hqpipe.pipeline.query_commands:verify", "Hash every byte of the current artifacts again."),
    "diff": ("hqpipe.pipeline.query_commands:diff", "Show what differs between two artifacts."),
    "gc": ("hqpipe.pipeline.query_commands:gc", "Remove results that no current or last run of a profile needs."),
    "init": ("hqpipe.pipeline.query_commands:init", "Make a new project."),
    "logs": ("hqpipe.stages.log_commands:logs", "Import, check, show and export logs."),
    "blind": ("hqpipe.stages.blind.commands:blind", "Check the diagnosis on data whose effect is withheld."),
    "doctor": ("hqpipe.pipeline.query_commands:doctor", "Check that this machine is ready."),
}
"""Command name → (where it is, one line of help)."""

REPORT = "run it again with --traceback, and report what that prints"

LONG_WORD = re.compile(r"\S{200,}")
"""What click repeats of a command line, and nobody would read."""

INTERRUPTED = 130
"""Exit code after Ctrl-C: 128 + SIGINT, as shells have it."""

READER_GONE = 141
"""Exit code when nobody reads standard output any more: 128 + SIGPIPE."""

# Spinning OpenMP threads slow the simulation beside them, and the number of threads changes the last bits of
# sums; both must be set before the libraries are loaded. A user's own setting is kept.
ENVIRONMENT = {
    "OMP_WAIT_POLICY": "PASSIVE",
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
}


class LazyGroup(click.Group):
    """A group that lists its commands without importing them.

    Args:
        table: the stages; each becomes a command. Commands find the table as click's ``obj``.
    """

    def __init__(self, table: StageTable) -> None:
        super().__init__(
            name="hqpipe",
            help=HELP,
            params=[version_option, traceback_option()],
            context_settings={"obj": table, "max_content_width": 100},
        )
        self.table = table

    def list_commands(self, ctx: click.Context) -> list[str]:
        return [*self.table, *COMMANDS]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name in self.table:
            return load("hqpipe.pipeline.run_commands:StageCommand")(self.table[cmd_name])
        if cmd_name in COMMANDS:
            return load(COMMANDS[cmd_name][0])
        return None

    def resolve_command(self, ctx: click.Context, args: list[str]):
        known = self.list_commands(ctx)
        if args[0] not in known and not args[0].startswith("-"):
            hint = near_match(args[0].replace("_", "-"), known)
            raise click.UsageError(f"unknown command '{args[0]}'{hint}", ctx)
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Stages, in the order of `hqpipe run all`"):
            formatter.write_dl([(stage.name, stage.help) for stage in self.table.values() if not stage.alone])
        if alone := [(stage.name, stage.help) for stage in self.table.values() if stage.alone]:
            with formatter.section("Stages that run alone"):
                formatter.write_dl(alone)
        with formatter.section("Commands"):
            formatter.write_dl([(name, help_line) for name, (_, help_line) in COMMANDS.items()])


def _show_version(ctx: click.Context, param: click.Parameter, value: bool) -> None:
    if value:
        click.echo(f"hqpipe {__version__}")
        ctx.exit()


version_option = click.Option(
    ["--version"],
    is_flag=True,
    expose_value=False,
    is_eager=True,
    callback=_show_version,
    help="Show the version.",
)


def run_cli(table: StageTable, arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code; errors are reported on standard error, and with ``--json`` also as JSON.

    Args:
        table: the stages.
        arguments: instead of the process's own.
    """
    for name, value in ENVIRONMENT.items():
        os.environ.setdefault(name, value)
    words = list(sys.argv[1:] if arguments is None else arguments)
    if not any(word.startswith("--json") for word in words):
        return _run(table, words).code
    from hqpipe.pipeline.answer import answering, is_asked_for, print_answer

    if not is_asked_for(words):
        return _run(table, words).code
    with answering(words) as own:
        end = _run(table, words)
    if not own and end.code == 0:
        return 0  # it was help that was asked for
    try:
        print_answer(own, end.code, end.error)
        sys.stdout.flush()
    except ReaderGone:
        return READER_GONE
    except HqpipeError as error:  # standard output is full
        return _tell(error).code
    return end.code


@dataclass(frozen=True)
class _End:
    """How a command ended: its exit code, and the error as of `HqpipeError.to_json`."""

    code: int
    error: dict[str, str | None] | None = None


def _run(table: StageTable, words: list[str]) -> _End:
    """Run one command; errors are reported on standard error."""
    try:
        code = LazyGroup(table).main(words, prog_name="hqpipe", standalone_mode=False)
        sys.stdout.flush()
        return _End(code if isinstance(code, int) else 0)
    except click.ClickException as error:
        error.message = LONG_WORD.sub(lambda word: f"{word[0][:80]}…", error.message)
        error.show()
        return _End(UsageError.exit_code, _click_error(error).to_json())
    except Interrupted as error:
        ignore_signals()
        return _interrupted(error.exit_code)
    except (click.Abort, KeyboardInterrupt):
        return _interrupted(INTERRUPTED)
    except ReaderGone:
        return _End(READER_GONE)
    except SystemExit as error:  # of shell completion, or of a library
        return _End(error.code if isinstance(error.code, int) else int(error.code is not None))
    except HqpipeError as error:
        return _tell(error)
    except Exception as error:
        failure = system_failure(error) or HqpipeError(f"{type(error).__name__}: {error}", fix=REPORT)
        return _tell(failure)


def _tell(error: HqpipeError) -> _End:
    """Print the error that is being handled."""
    if os.environ.get("HQPIPE_TRACEBACK"):
        traceback.print_exc()
    print(f"error: {error}", file=sys.stderr)
    return _End(error.exit_code, error.to_json())


def _interrupted(code: int) -> _End:
    print(MESSAGE, file=sys.stderr)
    return _End(code, HqpipeError(STATE, fix=REMEDY).to_json())


def _click_error(error: click.ClickException) -> UsageError:
    """What click complains about: which option or argument, and where to read what is expected."""
    ctx = getattr(error, "ctx", None)
    param = getattr(error, "param", None)
    field = getattr(error, "option_name", None)
    if param is not None:
        field = param.human_readable_name if isinstance(param, click.Argument) else param.opts[-1]
    path = ctx.command_path if ctx is not None else "hqpipe"
    return UsageError(error.format_message(), field=field, fix=f"`{path} --help` lists what is expected")


def main(table: StageTable | None = None) -> NoReturn:
    """Run the process's command line and exit, with streams that can be written to and signals that end it in order.

    Args:
        table: the stages; those of hqpipe by default.
    """
    raise_on_signals()
    try:
        prepare_streams()
        if table is None:
            from hqpipe.stages import STAGES as table
        code = run_cli(table)
        ignore_signals()
    except Interrupted as error:
        end(error)
    sys.exit(code)


if __name__ == "__main__":
    main()
