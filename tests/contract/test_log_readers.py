"""Every registered log format keeps the same contract."""

from __future__ import annotations

import pytest

from hqpipe.errors import LogError
from hqpipe.logs import LOG_READERS


def test_no_two_formats_claim_a_suffix():
    suffixes = [suffix for reader in LOG_READERS.values() for suffix in reader.suffixes]
    assert len(suffixes) == len(set(suffixes))


@pytest.mark.parametrize("name", list(LOG_READERS))
class TestEveryReader:
    def test_suffixes_are_lower_case_and_dotted(self, name):
        suffixes = LOG_READERS[name].suffixes
        assert suffixes and all(s.startswith(".") and s == s.lower() for s in suffixes)

    @pytest.mark.parametrize("content", [b"", b"\x00" * 64, b"not a log", b"PAR1\x00\x00PAR1"])
    def test_rubbish_is_a_log_error_that_names_the_file(self, name, content, tmp_path):
        path = tmp_path / f"trial{LOG_READERS[name].suffixes[0]}"
        path.write_bytes(content)
        with pytest.raises(LogError, match="trial"):
            LOG_READERS[name].read(path)
