"""``hqpipe run all`` and one command per stage."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from inspect import cleandoc
from typing import Any

import click

from hqpipe.errors import HqpipeError, UsageError, shown
from hqpipe.pipeline.answer import answer
from hqpipe.pipeline.completion import chain_stages
from hqpipe.pipeline.options import Folder, running_options, with_options
from hqpipe.pipeline.overrides import Override, parse_override
from hqpipe.pipeline.stage import Input, Stage, StageTable


def _check_target(ctx: click.Context, param: click.Parameter, value: str) -> str:
    if value == "all":
        return value
    if value in ctx.obj:
        message = f"a stage runs alone as `hqpipe {value}`; expected `hqpipe run all`"
        raise UsageError(message, field="all", fix=f"type `hqpipe {value}`")
    raise UsageError(f"expected `hqpipe run all`, got {shown(value)}", field="all", fix="type `hqpipe run all`")


@with_options(*running_options("STAGE.KEY=VALUE"))
@click.command()
@click.argument("target", metavar="all", callback=_check_target, shell_complete=lambda ctx, param, incomplete: ["all"])
@click.option(
    "--from", "first", metavar="STAGE", help="Start here, on the current artifacts.", shell_complete=chain_stages
)
@click.option("--until", "last", metavar="STAGE", help="Stop after this stage.", shell_complete=chain_stages)
@click.pass_obj
def run(
    table: StageTable,
    target: str,
    first: str | None,
    last: str | None,
    profile: str | None,
    overrides: tuple[str, ...],
    seed: int | None,
    **options: bool,
) -> None:
    """Bring every artifact up to date: run what changed, keep the rest.

    --seed replaces the seed at the top of pipeline.yaml; a seed inside a stage's section stays.
    """
    from hqpipe.pipeline.plan import Planner
    from hqpipe.pipeline.project import open_project

    stages = table.between(first, last)
    project = open_project(table)
    settings = project.configuration.resolve(
        table.values(), profile=profile, overrides=overrides, seed=seed, robot=project.robot_folder()
    )
    _execute(Planner(project, settings, force=options["force"]), stages, **options)


class StageCommand(click.Command):
    """One stage; its help ends with its parameters."""

    def __init__(self, stage: Stage) -> None:
        self.stage = stage
        inputs = [
            click.Option(
                [needed.option, needed.name],
                type=Folder(),
                metavar="DIR",
                help=needed.help or f"Read this folder instead of artifacts/{needed.artifact}.",
            )
            for needed in stage.inputs
        ]
        spellings = [
            click.Option([other, _also(needed, other)], type=Folder(), hidden=True)
            for needed in stage.inputs
            for other in needed.also
        ]
        flags = [click.Option([name], is_flag=True, expose_value=False, help=text) for name, text in stage.flags]
        switches = [click.Option([name], is_flag=True, help=text) for name, text in stage.switches]
        settings = [click.Option([name], metavar=value, help=text) for name, value, text in stage.settings]
        super().__init__(
            stage.name,
            params=[*inputs, *spellings, *flags, *switches, *settings, *running_options("KEY=VALUE")],
            callback=click.pass_obj(self.run),
            help=f"{stage.help}\n\nWrites artifacts/{stage.artifact}.",
        )

    def run(
        self,
        table: StageTable,
        profile: str | None,
        overrides: tuple[str, ...],
        seed: int | None,
        **options: Any,
    ) -> None:
        """Run the stage on the folders that were given, or on the current artifacts as they are."""
        from hqpipe.pipeline.plan import Planner
        from hqpipe.pipeline.project import open_project

        section = self.stage.section
        changes: list[str | Override] = [f"{section}.{text.removeprefix(f'{section}.')}" for text in overrides]
        if seed is not None:
            changes.append(f"{section}.seed={seed}")
        switches = [self.stage.parameter(option) for option, _ in self.stage.switches]
        changes += [f"{section}.{name}=true" for name in switches if options.pop(name)]
        for option, _, _ in self.stage.settings:
            name = self.stage.parameter(option)
            if (value := options.pop(name)) is not None:
                change = parse_override(f"{section}.{name}={value}", (section,))
                changes.append(replace(change, text=value, option=option))
        named = {needed.name: _named(needed, options) for needed in self.stage.inputs}
        explicit = {name: path for name, path in named.items() if path is not None}
        project = open_project(table)
        settings = project.configuration.resolve(
            [self.stage], profile=profile, overrides=changes, robot=project.robot_folder()
        )
        planner = Planner(project, settings, force=options["force"], explicit=explicit)
        _execute(planner, [self.stage], **options)
        if not options["dry_run"]:
            print(f"→ {planner.project.store.link(self.stage.artifact)}", file=sys.stderr)

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        params = self.stage.load_params()
        rows = [("seed", "the seed of pipeline.yaml"), *_flat(params().model_dump(mode="json"))]
        with formatter.section("Parameters for --set, and their defaults"):
            formatter.write_dl(rows)
        formatter.write(f"\n{cleandoc(params.__doc__ or '')}\n")


def _also(needed: Input, option: str) -> str:
    """Under what name click keeps the folder that a second spelling of an option names."""
    return f"{needed.name}_{option.strip('-')}"


def _named(needed: Input, options: dict[str, Any]) -> Any:
    """The folder that was named for an input, taken out of `options`; None for none."""
    given = {needed.option: options.pop(needed.name)}
    given |= {other: options.pop(_also(needed, other)) for other in needed.also}
    folders = {option: folder for option, folder in given.items() if folder is not None}
    if len(folders) > 1:
        text = f"{' and '.join(folders)} name the same input"
        raise UsageError(text, field=needed.option, fix=f"give {needed.option} alone")
    return next(iter(folders.values()), None)


def _flat(params: dict[str, Any], above: str = "") -> list[tuple[str, str]]:
    """Dotted names and values of nested parameters."""
    rows = []
    for key, value in params.items():
        if isinstance(value, dict) and value:
            rows += _flat(value, f"{above}{key}.")
        else:
            rows.append((f"{above}{key}", json.dumps(value, ensure_ascii=False)))
    return rows


def _execute(planner: Any, stages: list[Stage], *, force: bool, dry_run: bool, explain: bool, as_json: bool) -> None:
    """Preview or run `stages`, and tell the result."""
    planner.project.table.check_robot(planner.project.robot_folder(), stages)
    if dry_run:
        _preview(planner, stages, explain, as_json)
        return
    from hqpipe.pipeline.executor import Executor
    from hqpipe.pipeline.lock import exclusive

    executor = Executor(planner, on_decision=_explain if explain else lambda decision: None)
    failure: HqpipeError | None = None
    try:
        with exclusive(planner.project.store.folder):
            try:
                executor.run(stages)
            except HqpipeError as error:
                failure = error
        _tell_outcomes(executor.outcomes)
    finally:
        if as_json:
            outcomes = [outcome.to_json() for outcome in executor.outcomes]
            answer(profile=planner.settings.profile, stages=outcomes)
    if failure:
        raise failure


def _preview(planner: Any, stages: list[Stage], explain: bool, as_json: bool) -> None:
    if as_json:
        answer(profile=planner.settings.profile, dry_run=True, stages=[])
    decisions = planner.preview(stages)
    if explain:
        for decision in decisions:
            _explain(decision)
    if as_json:
        answer(stages=[decision.to_json() for decision in decisions])
        return
    from hqpipe.pipeline.render import print_plan

    print_plan(decisions)
    if any(reason.kind == "upstream" for decision in decisions for reason in decision.reasons):
        print("A stage is kept after all if its inputs come out as they were.")


def _explain(decision: Any) -> None:
    print(f"{decision.stage.name}: {decision.action}", file=sys.stderr)
    for text in [reason.text for reason in decision.reasons] or ["nothing changed"]:
        print(f"  {text}", file=sys.stderr)


def _tell_outcomes(outcomes: list[Any]) -> None:
    """The table, and a warning for each stage whose forced run gave other bytes."""
    if not outcomes:
        return
    from hqpipe.pipeline.render import print_outcomes

    print_outcomes(outcomes)
    for outcome in outcomes:
        if outcome.unreproduced:
            files = ", ".join(outcome.unreproduced)
            name = outcome.decision.stage.name
            print(f"warning: {name} did not make the same bytes as before: {files}", file=sys.stderr)
