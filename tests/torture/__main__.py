"""``python -m tests.torture --seed S --minutes M --out FILE``; exits 1 if anything failed.

--only PART --trial N makes one trial again, --repeat FILE one odd file; --add FILES adds up earlier runs.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import time
import traceback
from pathlib import Path

from hqpipe.cli import ENVIRONMENT

from .processes import ROOT
from .tally import Tally

_PATIENCE_S = 900.0  # beyond its time, for the last trial of a part


def main() -> int:
    arguments = _arguments()
    for name, value in ENVIRONMENT.items():
        os.environ.setdefault(name, value)
    if arguments.add:
        return _report(_sum(arguments.add), arguments.out)
    if arguments.repeat:
        return _repeat(arguments.repeat)
    if arguments.only:
        return _one_part(arguments)
    print(f"seed {arguments.seed}, {arguments.minutes:g} minutes, {arguments.jobs} processes", flush=True)
    return _report(_all_parts(arguments), arguments.out)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tests.torture", description=__doc__)
    parser.add_argument("--seed", type=int, default=int(time.time()) % 100000)
    parser.add_argument("--minutes", type=float, default=12.0)
    parser.add_argument("--out", type=Path, help="default: build/torture-SEED.json, and build/torture.json for a sum")
    parser.add_argument("--jobs", type=int, default=max(1, min(2, os.cpu_count() or 1)), help="processes side by side")
    parser.add_argument("--only", help="one part")
    parser.add_argument("--trial", type=int, help="with --only: this trial alone")
    parser.add_argument("--repeat", type=Path, metavar="FILE")
    parser.add_argument("--add", type=Path, nargs="+", metavar="FILE")
    arguments = parser.parse_args()
    if arguments.out is None:
        arguments.out = ROOT / "build" / ("torture.json" if arguments.add else f"torture-{arguments.seed}.json")
    return arguments


def _one_part(arguments: argparse.Namespace) -> int:
    """Run one part in this process, saving the tally after every trial."""
    from .parts import run_part

    tally, started, saved = Tally([arguments.seed]), time.monotonic(), 0.0

    def go_on(done: int) -> bool:
        nonlocal saved
        passed = time.monotonic() - started
        tally.seconds[arguments.only] = passed
        if passed - saved > 5.0:
            tally.save(arguments.out)
            saved = passed
        return done < 1 if arguments.trial is not None else passed < 60.0 * arguments.minutes

    try:
        run_part(arguments.only, arguments.seed, tally, go_on, arguments.trial or 0)
    except Exception as error:
        traceback.print_exc()
        tally.problem("traceback", "the harness", arguments.only, f"{type(error).__name__}: {error}: {error.__cause__}")
    return _report(tally, arguments.out)


def _all_parts(arguments: argparse.Namespace) -> Tally:
    """Every part in a process of its own, the longest first, as many side by side as there are jobs."""
    from .chain import small_chain
    from .parts import PARTS

    started = time.monotonic()
    small_chain()
    left = max(10.0, 60.0 * arguments.minutes - (time.monotonic() - started))
    pending = sorted(PARTS, key=lambda name: -PARTS[name].share)
    running: dict[str, tuple[subprocess.Popen, float, Path]] = {}
    tally = Tally()
    while pending or running:
        while pending and len(running) < arguments.jobs:
            name = pending.pop(0)
            minutes = min(PARTS[name].share * arguments.jobs, 1.0) * left / 60.0
            out = arguments.out.with_name(f"{arguments.out.stem}-{name}.part.json")
            out.unlink(missing_ok=True)
            words = ["--only", name, "--minutes", str(minutes), "--seed", str(arguments.seed), "--out", str(out)]
            process = subprocess.Popen(
                [sys.executable, "-m", "tests.torture", *words],
                cwd=ROOT,
                stdout=subprocess.DEVNULL,
                start_new_session=True,
            )
            running[name] = process, time.monotonic() + 60.0 * minutes + _PATIENCE_S, out
            print(f"{name}: {minutes:.1f} minutes", flush=True)
        time.sleep(0.5)
        for name, (process, deadline, out) in list(running.items()):
            if process.poll() is None and time.monotonic() < deadline:
                continue
            del running[name]
            tally.add(_part(name, process, out))
    tally.seeds = [arguments.seed]
    return tally


def _part(name: str, process: subprocess.Popen, out: Path) -> Tally:
    """What a part found; a part that hung or fell over counts as a failure of its own."""
    hung = process.poll() is None
    if hung:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    tally = Tally.load(out) if out.is_file() else Tally()
    out.unlink(missing_ok=True)
    if hung:
        tally.problem("hang", "the harness", name, "a trial did not end", None)
    elif process.returncode not in (0, 1):
        tally.problem("traceback", "the harness", name, f"the part ended with {process.returncode}", None)
    return tally


def _repeat(file: Path) -> int:
    """Try one saved change again and say what comes of it."""
    from .fuzz import try_case
    from .parts import targets, workplace

    saved = json.loads(file.read_text())
    with workplace() as folder:
        target = next(target for target in targets(folder) if target.name == saved["target"])
        result = try_case(target, saved["change"], folder / "case")
    print(json.dumps(result, indent=1))
    return int(result["end"] == "exception")


def _sum(files: list[Path]) -> Tally:
    tally = Tally()
    for file in files:
        tally.add(Tally.load(file))
    return tally


def _report(tally: Tally, out: Path) -> int:
    """Save and print the tally; the exit code."""
    tally.save(out)
    print(tally.table())
    if tally.problems:
        print(f"\n{len(tally.problems)} failures; all of them with what repeats them are in {out}:")
        print(tally.listing())
    return int(bool(tally.problems))


if __name__ == "__main__":
    sys.exit(main())
