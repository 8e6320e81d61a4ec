"""The loops of a chain as a module: written into the cache folder under the hash of its text, and imported from there."""

from __future__ import annotations

import hashlib
import importlib.util
import linecache
import os
import sys
import tempfile
from contextlib import suppress
from pathlib import Path
from types import ModuleType

from hqpipe.machine.compose.batches import write_batches
from hqpipe.machine.compose.rows import Memory, write_rows
from hqpipe.machine.compose.source import Source
from hqpipe.machine.compose.windows import write_windows
from hqpipe.machine.compose.wiring import Chain
from hqpipe.system.imported_sources import digest_of_sources
from hqpipe.system.kernel_cache import VARIABLE, is_writable

HEAD = '''"""Loops of the base model {base} with its effects; written by hqpipe.machine.compose, not to be edited.

{digest}
"""

import numpy as np
from numba import njit

from hqpipe.machine.compose.shared import RING, counts, delayed, delayed_block, lay_out, past, remembered

CACHE = {cache}
PASSES = 10  # of the search for what a state holds at the start of a trial
CLOSE = 1e-4  # relative: where it ends
ROUGH = 0.02  # s from sample to sample of its first passes, which only tell where the others begin
FEWEST = 10  # samples of such a pass
SAMPLES = 256  # that a pass works on at a time; a block of each signal stays in the cache
MEMORY = {memory}'''


def source_of(chain: Chain, cache: bool) -> str:
    """Text of the module of a chain; cache: whether numba is to keep what it compiles."""
    source = Source()
    write_rows(source, chain)
    write_batches(source, chain)
    write_windows(source, chain)
    functions = [call.function for link in chain.links for call in (link.call, link.undo) if call]
    functions += [constant.call.function for constant in chain.constants]
    functions += [chain.law.function, chain.plain.function, chain.needed.function]
    files = sorted({Path(f.py_func.__code__.co_filename) for f in functions} | {Path(__file__).with_name("shared.py")})
    digest = hashlib.sha256("".join(map(digest_of_sources, files)).encode()).hexdigest()
    return source.text(HEAD.format(base=chain.base.name, digest=digest, cache=cache, memory=Memory(chain).columns))


def loops_of(chain: Chain) -> ModuleType:
    """The compiled loops of a chain.

    Where no folder for compiled code can be written the module lives in memory alone and is compiled in every process.
    """
    folder = _folder()
    if folder is not None:
        text = source_of(chain, cache=True)
        name = _name(chain, text)
        path = folder / f"{name}.py"
        with suppress(OSError):
            if not path.exists() or path.read_text() != text:
                _write(path, text)
            return _imported(name, path)
    text = source_of(chain, cache=False)
    return _executed(_name(chain, text), text)


def _folder() -> Path | None:
    named = os.environ.get(VARIABLE)
    folder = Path(named) / "chains" if named else None
    if folder is None or not is_writable(folder):
        return None
    with suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
        return folder
    return None


def _name(chain: Chain, text: str) -> str:
    return f"hqpipe_chain_{chain.base.name}_{hashlib.sha256(text.encode()).hexdigest()[:16]}"


def _write(path: Path, text: str) -> None:
    """Write a file at once; of several processes that do so, one is the last."""
    handle, scratch = tempfile.mkstemp(dir=path.parent, prefix=path.stem, suffix=".tmp")
    try:
        with os.fdopen(handle, "w") as file:
            file.write(text)
        os.replace(scratch, path)
    except OSError:
        with suppress(OSError):
            os.unlink(scratch)
        raise


def _imported(name: str, path: Path) -> ModuleType:
    if name in sys.modules:
        return sys.modules[name]
    spec = importlib.util.spec_from_file_location(name, path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
    return module


def _executed(name: str, text: str) -> ModuleType:
    """The module of a text without a file; tracebacks show its lines all the same."""
    if name in sys.modules:
        return sys.modules[name]
    place = f"<{name}>"
    linecache.cache[place] = (len(text), None, text.splitlines(keepends=True), place)
    module = ModuleType(name)
    module.__file__ = place
    sys.modules[name] = module
    exec(compile(text, place, "exec"), module.__dict__)
    return module
