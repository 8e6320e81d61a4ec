"""``hqpipe logs``: the commands that work on log sets; each is imported when it is invoked."""

from __future__ import annotations

import click

from hqpipe.errors import near_match
from hqpipe.registry import load

COMMANDS = {
    "check": ("hqpipe.stages.log_commands.check:check", "Say what a log set is good for, and what is wrong with it."),
    "info": ("hqpipe.stages.log_commands.info:info", "Show what is in a log set, with a sparkline per signal."),
    "export": ("hqpipe.stages.log_commands.export:export", "Write a log set as MCAP (ROS 2) or CSV files."),
}
"""Command name → (where it is, one line of help)."""


class LogCommands(click.Group):
    """Lists its commands without importing them."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        return load(COMMANDS[cmd_name][0]) if cmd_name in COMMANDS else None

    def resolve_command(self, ctx: click.Context, args: list[str]):
        if args[0] not in COMMANDS and not args[0].startswith("-"):
            raise click.UsageError(f"unknown command '{args[0]}'{near_match(args[0], COMMANDS)}", ctx)
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl([(name, help_line) for name, (_, help_line) in COMMANDS.items()])


logs = LogCommands(name="logs", help="Import, check, show and export logs.")
