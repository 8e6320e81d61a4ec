"""Every registered foreign format keeps the same contract."""

from __future__ import annotations

import pytest

from hqpipe.errors import LogError
from hqpipe.logs.imports import FOREIGN_READERS, PRESETS


def test_formats_that_share_a_suffix_say_which_files_are_theirs():
    claimed: dict[str, list[type]] = {}
    for reader in FOREIGN_READERS.values():
        for suffix in reader.suffixes:
            claimed.setdefault(suffix, []).append(reader)
    for suffix, readers in claimed.items():
        assert all(hasattr(reader, "claims_file") for reader in readers[:-1]), suffix


@pytest.mark.parametrize("name", list(FOREIGN_READERS))
class TestEveryForeignReader:
    def test_suffixes_are_lower_case_and_dotted(self, name):
        assert all(s.startswith(".") and s == s.lower() for s in FOREIGN_READERS[name].suffixes)

    def test_extra_is_one_of_the_project(self, name):
        assert FOREIGN_READERS[name].extra in (None, "hdf5", "ros", "px4", "mdf")

    @pytest.mark.parametrize(
        "content", [b"", b"\x00" * 64, b"not a log", b"PAR1\x00\x00PAR1", b"\x89HDF\r\n\x1a\n" * 9]
    )
    def test_rubbish_is_an_error_that_names_file_and_fix(self, name, content, tmp_path):
        for suffix in FOREIGN_READERS[name].suffixes:
            path = tmp_path / f"trial{suffix}"
            path.write_bytes(content)
            with pytest.raises(LogError, match="trial") as caught:
                FOREIGN_READERS[name].read(path)
            assert caught.value.file and caught.value.fix and "\n" not in str(caught.value)


@pytest.mark.parametrize("name", list(PRESETS))
def test_presets_say_what_they_are_for(name):
    assert (PRESETS[name].__doc__ or "").strip()
