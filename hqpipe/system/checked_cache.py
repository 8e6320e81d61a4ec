"""Compiled code comes from numba's cache only if it is whole and that of the function which is called.

numba trusts what it finds: a cache file that was cut by a loss of power ends every later run, and two processes that first
compile a function for different arguments at the same time may file one under the name of the other. It also
goes by the file of a function alone, though its code holds functions and constants of other files. To import this module is to
have code compiled anew in all of these cases, and to do without a cache that cannot be written.
"""

from __future__ import annotations

import hashlib
import pickle
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from numba.core.caching import Cache, IndexDataCacheFile

from hqpipe.system.imported_sources import PACKAGE, digest_of_sources

_load_index, _load, _save = IndexDataCacheFile._load_index, IndexDataCacheFile.load, IndexDataCacheFile.save
_cache = Cache.__init__


def cache(self: Cache, function: Any) -> None:
    """Make the cache of a function, which holds for the present state of all files that the function rests on."""
    _cache(self, function)
    if function.__module__.split(".")[0] == PACKAGE:
        stamp = self._cache_file._source_stamp
        self._cache_file._source_stamp = (stamp, digest_of_sources(Path(function.__code__.co_filename)))


def load_index(self: IndexDataCacheFile) -> dict[Any, str]:
    try:
        return _load_index(self)
    except Exception:  # damage can raise anything; the index is then written anew
        return {}


def load(self: IndexDataCacheFile, key: Any) -> Any:
    try:
        digest, content = _load(self, key)
        if digest == hashlib.sha256(content).digest():
            owner, data = pickle.loads(content)
            return data if owner == key else None
    except Exception:  # likewise, and TypeError where there is no entry
        return None
    return None


def save(self: IndexDataCacheFile, key: Any, data: Any) -> None:
    content = self._dump((key, data))
    _save(self, key, (hashlib.sha256(content).digest(), content))


@contextmanager
def without_errors_of_files(self: Cache) -> Iterator[None]:
    """Around loading and saving: a full or read-only disk means to compile, not to fail."""
    with suppress(OSError):
        yield


Cache.__init__ = cache
IndexDataCacheFile._load_index = load_index
IndexDataCacheFile.load = load
IndexDataCacheFile.save = save
Cache._guard_against_spurious_io_errors = without_errors_of_files
