"""What the checks of logs say to sound log sets, and to copies spoilt in known ways; no cause is searched.

    python benchmarks/degraded_logs.py DIR … [--seconds 10] [--out build/degraded_logs]

For every log set and every way of spoiling it: whether it can be read, whether what was planted is found and costs what
has it, and what is accused falsely. What the set as it came is accused of is told apart (row "sound").
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import shutil
import tempfile
import time
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

from log_degradations import Planted, Trials, by_seed, variants

from hqpipe.errors import HqpipeError
from hqpipe.gap.checks.confirm import confirmed
from hqpipe.gap.checks.sanity import check_logs
from hqpipe.gap.intake import take_in
from hqpipe.gap.layer_intake import position_checks
from hqpipe.logs.log_set import read_log_set
from hqpipe.logs.trajectory import LogSet

WINDOW_ROWS, WINDOW_S = 10, 0.1
UNITS = ("degrees", "looks like", "times the derivative", "times its position")  # of warnings about units


@dataclass(frozen=True)
class Claim:
    """One accusation: its kind, and the joints and trials that it names (empty for all)."""

    kind: str
    joints: tuple[str, ...]
    trials: tuple[str, ...]


@dataclass(frozen=True)
class Row:
    """One variant of one set.

    Attributes:
        read: "yes", or why not. expected: what was planted; empty for nothing.
        found: the planted was named by a check. cost: what has it was left out, or the diagnosis ended.
        false_claims: kinds that were named though not planted. false_costs: those of them that cost something.
        ended: whether the diagnosis would end. seconds: of the checks.
    """

    set: str
    variant: str
    read: str
    expected: str
    found: bool | None
    cost: bool | None
    false_claims: tuple[str, ...]
    false_costs: tuple[str, ...]
    ended: bool
    seconds: float


def load(folder: Path, seconds: float) -> Trials:
    """The first seconds of every trial: time and the channels of the joints."""
    import pyarrow.parquet as pq

    files = {trial.file for trial in read_log_set(folder).trials}
    trials = {}
    for path in sorted(folder.glob("*.parquet")):
        if path.name not in files:
            continue
        table = pq.read_table(path)
        columns = {
            n: table[n].to_numpy().astype(float) for n in table.column_names if n == "time" or n.startswith("joint/")
        }
        kept = columns["time"] - columns["time"][0] <= seconds
        trials[path.name] = {n: v[kept] for n, v in columns.items()}
    return trials


def write(trials: Trials, source: Path, folder: Path) -> None:
    """A log set on disk, with the manifest of its source; its rate is left to the clock."""
    import pyarrow as pa
    import pyarrow.parquet as pq
    import yaml

    for file, columns in trials.items():
        pq.write_table(pa.table(columns), folder / file)
    if (source / "logset.yaml").is_file():
        manifest = yaml.safe_load((source / "logset.yaml").read_text())
        manifest.pop("rate_hz", None)
        (folder / "logset.yaml").write_text(yaml.safe_dump(manifest))


def judge(
    name: str, source: Path, trials: Trials, variant: Any, known: set[Claim], seed: int
) -> tuple[Row, set[Claim]]:
    """One row, and every claim that was made."""
    planted = variant.planted
    expected = ", ".join(planted.kinds)
    with tempfile.TemporaryDirectory() as scratch:
        write(by_seed(variant, trials, seed), source, Path(scratch))
        try:
            log_set = read_log_set(scratch)
        except HqpipeError as error:
            text = str(error).replace(scratch, "").strip("/")
            return Row(name, variant.name, text[:160], expected, None, None, (), (), True, 0.0), set()
    started = time.perf_counter()
    claims, costs, ended = _claims(log_set)
    hit = [claim for claim in (*claims, *(costs or ())) if _names(claim, planted)]
    paid = [claim for claim in costs or () if _names(claim, planted)]
    spurious = [c for c in claims if c not in hit and not _listed(c, known)]
    unjust = [c for c in costs or () if c not in paid and not _listed(c, known)]
    row = Row(
        set=name,
        variant=variant.name,
        read="yes",
        expected=expected,
        found=bool(hit) if planted.kinds else None,
        cost=bool(paid) if planted.kinds and planted.costs and costs is not None else None,
        false_claims=tuple(sorted({c.kind for c in spurious})),
        false_costs=tuple(sorted({c.kind for c in unjust})),
        ended=ended,
        seconds=round(time.perf_counter() - started, 1),
    )
    return row, set(claims)


def _claims(log_set: LogSet) -> tuple[list[Claim], list[Claim] | None, bool]:
    """What is said, what of it costs something (None where there is no model to ask), and whether the diagnosis would end."""
    window_s = max(WINDOW_S, WINDOW_ROWS / log_set.rate_hz)
    steps = round(window_s * log_set.rate_hz)
    defects = check_logs(log_set, window_s=window_s)
    claims = [Claim(d.kind, d.joints, d.trials) for d in defects]
    claims += [
        Claim("units", _joints_in(text, log_set), ()) for text in log_set.warnings if any(u in text for u in UNITS)
    ]
    if log_set.control_mode == "valve":  # a layer answers, which leaves out what these checks say
        _, left, _ = position_checks(log_set)
        return claims, [Claim(item.kind, item.joints, item.trials) for item in left], False
    try:
        intake = take_in(log_set, window_s)
    except HqpipeError:  # nothing to compare models on
        return claims, None, True
    ended = bool(intake.reasons)
    if hasattr(intake, "left_out"):
        costs = [Claim(item.kind, item.joints, item.trials) for item in intake.left_out]
    else:
        fatal = [d for d in defects if d.fatal and d.kind not in ("velocity_mismatch", "unsigned")]
        costs = [Claim(d.kind, d.joints, d.trials) for d in fatal if confirmed(d, log_set, steps)]
    if intake.signed.joints:
        claims.append(Claim("unsigned", intake.signed.joints, ()))
    return claims, costs, ended


def _joints_in(text: str, log_set: LogSet) -> tuple[str, ...]:
    return tuple(joint for joint in log_set.joints if f"{joint}" in text)


def _names(claim: Claim, planted: Planted) -> bool:
    """Whether a claim names what was planted, where it was planted."""
    if claim.kind not in planted.kinds:
        return False
    there = planted.joint is None or not claim.joints or planted.joint in claim.joints
    return there and (planted.file is None or not claim.trials or planted.file in claim.trials)


def _listed(claim: Claim, known: Iterable[Claim]) -> bool:
    """Whether the set as it came was accused of the same."""
    return any(claim.kind == other.kind and set(claim.joints) <= set(other.joints) for other in known)


def table(rows: list[Row]) -> Any:
    from rich.table import Table

    found = Table("set", "variant", "read", "expected", "found", "cost", "false claims", "false costs", "ends", "s")
    mark = {True: "yes", False: "NO", None: "–"}
    for r in rows:
        cells = (
            r.set,
            r.variant,
            r.read if r.read == "yes" else f"no: {r.read[:48]}",
            r.expected or "–",
            mark[r.found],
        )
        rest = (
            mark[r.cost],
            ", ".join(r.false_claims),
            ", ".join(r.false_costs),
            "ends" if r.ended else "",
            f"{r.seconds:.1f}",
        )
        found.add_row(*cells, *rest)
    return found


def summary(rows: list[Row]) -> dict[str, Any]:
    """Counts over all rows."""
    read = [r for r in rows if r.read == "yes"]
    planted = [r for r in read if r.found is not None]
    return {
        "variants": len(rows),
        "refused by the reader": len(rows) - len(read),
        "planted": len(planted),
        "planted and found": sum(bool(r.found) for r in planted),
        "planted that matters": sum(r.cost is not None for r in planted),
        "of that, left out": sum(bool(r.cost) for r in planted),
        "planted, and the diagnosis ends": sum(r.ended for r in planted),
        "variants with a false claim": sum(bool(r.false_claims) for r in read),
        "variants with a false cost": sum(bool(r.false_costs) for r in read),
    }


def write_results(rows: list[Row], folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    content = {"summary": summary(rows), "rows": [asdict(r) for r in rows]}
    (folder / "degraded_logs.json").write_text(json.dumps(content, indent=1, ensure_ascii=False) + "\n")
    with (folder / "degraded_logs.csv").open("w", newline="") as stream:
        writer = csv.DictWriter(stream, list(asdict(rows[0])))
        writer.writeheader()
        writer.writerows({k: " ".join(v) if isinstance(v, tuple) else v for k, v in asdict(r).items()} for r in rows)


def main() -> None:
    from rich.console import Console

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="+", type=Path, metavar="DIR")
    parser.add_argument("--seconds", type=float, default=10.0, help="of every trial")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="", help="variants whose name contains this, and the sound set")
    parser.add_argument("--out", type=Path, default=Path("build/degraded_logs"))
    options = parser.parse_args()
    rows: list[Row] = []
    for folder in options.folders:
        mode = read_log_set(folder).control_mode
        trials, known = load(folder, options.seconds), set()
        for variant in variants(trials, mode):
            if variant.name != "sound" and options.only not in variant.name:
                continue
            row, claims = judge(folder.name, folder, trials, variant, known, options.seed)
            known = claims if variant.name == "sound" else known
            rows.append(row)
            print(
                row.set,
                "|",
                row.variant,
                "|",
                row.read,
                "|",
                row.found,
                row.cost,
                row.false_claims,
                row.false_costs,
                flush=True,
            )
    console = Console(width=shutil.get_terminal_size((200, 50)).columns)
    console.print(table(rows))
    console.print(summary(rows))
    write_results(rows, options.out)


if __name__ == "__main__":
    main()
