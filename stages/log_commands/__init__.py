"""``hqpipe logs``: the commands that take log sets in and out; each is one file beside this one and one row here."""

from __future__ import annotations

import click

from hqpipe.errors import near_match
from hqpipe.registry import load

LOG_COMMANDS = {
    "import": ("hqpipe.stages.log_commands.import_logs:import_logs", "Make a log set of other programs' logs."),
    "check": ("hqpipe.stages.log_commands.check:check", "Say what a log set is good for, and what is wrong with it."),
    "info": ("hqpipe.stages.log_commands.info:info", "Show what is in a log set, with a sparkline per signal."),
    "export": ("hqpipe.stages.log_commands.export:export", "Write a log set as MCAP (ROS 2) or CSV files."),
}
"""Name → (where it is, one line of help)."""


class LogGroup(click.Group):
    """Lists its commands without importing them."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(LOG_COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        return load(LOG_COMMANDS[cmd_name][0]) if cmd_name in LOG_COMMANDS else None

    def resolve_command(self, ctx: click.Context, args: list[str]):
        if args[0] not in LOG_COMMANDS and not args[0].startswith("-"):
            raise click.UsageError(f"unknown command 'logs {args[0]}'{near_match(args[0], LOG_COMMANDS)}", ctx)
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl([(name, help_line) for name, (_, help_line) in LOG_COMMANDS.items()])


@click.group(cls=LogGroup)
def logs() -> None:
    """Import, check, show and export logs."""
