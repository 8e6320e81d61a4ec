"""Measurement data files (ASAM MDF 3 and 4)."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from hqpipe.files.documents import read_json
from hqpipe.logs.imports.decoding import AGAIN, decoding
from hqpipe.logs.imports.mdf_extract import ARRAYS, OUTLINE
from hqpipe.logs.imports.packages import needed
from hqpipe.logs.imports.recording import ImportLogError, Recording, Stream

_SECONDS = 120.0  # assumption: time to start on a busy machine, by far
_RATE = 2e6  # bytes/s; assumption: a slow disk, and channels that are unpacked one by one
_MAGIC = (b"MDF     ", b"UnFinMF ")


class MdfReader:
    """Channels of numbers in groups with a time master; conversions other than formulas are applied."""

    suffixes = (".mf4", ".mdf", ".dat")
    extra = "mdf"

    @staticmethod
    def claims_file(path: Path) -> bool:
        """Whether a file begins as an MDF file does; .dat has many other uses."""
        try:
            with path.open("rb") as stream:
                return stream.read(8) in _MAGIC
        except OSError:
            return False

    @staticmethod
    def read(path: Path) -> list[Recording]:
        """One recording with a stream per channel group.

        Raises:
            ImportLogError: no MDF file, damaged, or without a channel of numbers; or the package is missing.
        """
        needed("asammdf", "mdf", path)
        with decoding(path, "an MDF file"), TemporaryDirectory(prefix="hqpipe-mdf-") as folder:
            if not MdfReader.claims_file(path):
                raise ImportLogError(f"{path}: does not begin as an MDF file does", file=path, fix=AGAIN)
            _extract(path, folder)
            return [_recording(path, Path(folder))]


def _extract(path: Path, folder: str) -> None:
    """Run asammdf in a process of its own, which a damaged file can crash or keep busy for ever."""
    command = [sys.executable, "-m", "hqpipe.logs.imports.mdf_extract", str(path.absolute()), folder]
    most = _SECONDS + path.stat().st_size / _RATE
    try:
        done = subprocess.run(
            command, stdin=subprocess.DEVNULL, capture_output=True, text=True, errors="replace", timeout=most
        )
    except subprocess.TimeoutExpired as error:
        what = f"{path}: reading it takes more than {most:.0f} s, which a damaged file does"
        raise ImportLogError(what, file=path, fix=AGAIN) from error
    if done.returncode:
        last = (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1][:200]
        raise ImportLogError(
            f"{path}: not an MDF file that can be read (asammdf stopped: {last})", file=path, fix=AGAIN
        )


def _recording(path: Path, folder: Path) -> Recording:
    outline = read_json(folder / OUTLINE, AGAIN, ImportLogError)
    if "message" in outline:
        raise ImportLogError(outline["message"], file=path, fix=outline["fix"])
    streams = []
    with np.load(folder / ARRAYS, allow_pickle=False) as arrays:
        for index, (name, time_name, names, units) in enumerate(outline["streams"]):
            fields = {each: arrays[f"{index}_{number}"] for number, each in enumerate(names)}
            streams.append(Stream(name, fields, units, arrays[f"{index}"], time_name))
    return Recording(path, tuple(streams), notes=tuple(outline["notes"]))
