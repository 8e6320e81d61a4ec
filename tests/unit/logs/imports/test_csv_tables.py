"""Text tables as people and programs leave them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hqpipe.logs.imports.csv_table import CsvReader
from hqpipe.logs.imports.recording import ImportLogError

ROWS = ["0.0,1.5,-2.0", "0.1,1.6,-2.1", "0.2,1.7,-2.2", "0.3,1.8,-2.3"]
T, Q, TAU = np.array([0.0, 0.1, 0.2, 0.3]), np.array([1.5, 1.6, 1.7, 1.8]), np.array([-2.0, -2.1, -2.2, -2.3])


def read(tmp_path: Path, text: str | bytes, name: str = "a.csv"):
    path = tmp_path / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode("utf-8"))
    (recording,) = CsvReader.read(path)
    (stream,) = recording.streams
    return stream, recording.notes


PLAIN = "\n".join(["t,q,tau", *ROWS]) + "\n"
LAYOUTS = {
    "plain": PLAIN,
    "no newline at the end": PLAIN.rstrip(),
    "Windows lines": PLAIN.replace("\n", "\r\n"),
    "old Mac lines": PLAIN.replace("\n", "\r"),
    "semicolons and decimal commas": PLAIN.replace(",", ";").replace(".", ","),
    "tabs and decimal commas": PLAIN.replace(",", "\t").replace(".", ","),
    "tabs": PLAIN.replace(",", "\t"),
    "bars": PLAIN.replace(",", "|"),
    "blanks": PLAIN.replace(",", "   "),
    "blanks in columns": "\n".join("  " + "  ".join(f"{c:>8}" for c in line.split(",")) for line in PLAIN.splitlines()),
    "blanks after commas": PLAIN.replace(",", ", "),
    "quoted": "\n".join(",".join(f'"{cell}"' for cell in line.split(",")) for line in PLAIN.splitlines()),
    "trailing delimiter": PLAIN.replace("\n", ",\n"),
    "trailing delimiter in the header alone": PLAIN.replace("tau\n", "tau,\n"),
    "trailing delimiter in the rows alone": "t,q,tau\n" + "\n".join(row + "," for row in ROWS),
    "semicolons at the end of rows": PLAIN.replace("\n", ";\n"),
    "semicolons at the end of rows below a header": "t,q,tau\n" + "\n".join(row + ";" for row in ROWS),
    "semicolons at the end of rows, blanks between cells": PLAIN.replace(",", " ").replace("\n", ";\n"),
    "a separator and a semicolon at the end of rows": "t,q,tau\n" + "\n".join(row + ",;" for row in ROWS),
    "comments": "# recorded by rig 3\n# operator: me, myself\n" + PLAIN,
    "header in a comment": "# " + PLAIN,
    "MATLAB's comment": "% made today\n%t,q,tau\n" + "\n".join(ROWS),
    "title": "Test run 17\n\n" + PLAIN,
    "settings of as many cells above the header": "Interval,0.1,0.2\n" + PLAIN,
    "several settings above the header": "Axis1\nNumber of samples,1024\nInterval (ms),0.667\n" + PLAIN,
    "blank lines": PLAIN.replace("\n", "\n\n"),
    "byte order mark": b"\xef\xbb\xbf" + PLAIN.encode(),
    "UTF-16": PLAIN.encode("utf-16"),
    "exponents": PLAIN.replace("1.5", "15e-1").replace("-2.0", "-2.0E+00"),
    "plus signs": PLAIN.replace(",1.5", ",+1.5"),
}


@pytest.mark.parametrize("layout", list(LAYOUTS))
def test_every_layout_gives_the_same_table(tmp_path, layout):
    stream, _ = read(tmp_path, LAYOUTS[layout])
    fields = {name: values for name, values in stream.fields.items() if np.isfinite(values).any()}
    assert list(fields) == ["t", "q", "tau"]
    np.testing.assert_array_equal([fields["t"], fields["q"], fields["tau"]], [T, Q, TAU])


def test_units_in_a_row_of_their_own_and_in_names(tmp_path):
    stream, _ = read(tmp_path, "\n".join(["t,q,tau", "[s],[deg],[N·m]", *ROWS]))
    assert stream.units == {"t": "s", "q": "deg", "tau": "N·m"} and len(stream.fields["t"]) == 4
    stream, _ = read(tmp_path, "\n".join(["t (ms),q [deg],tau[3]", *ROWS]))
    assert stream.units == {"t (ms)": "ms", "q [deg]": "deg"}
    stream, _ = read(tmp_path, "t,q,tau\ns,°,Nm\n".encode("cp1252") + "\n".join(ROWS).encode())
    assert stream.units == {"t": "s", "q": "°", "tau": "Nm"}


def test_missing_cells_are_nan(tmp_path):
    stream, notes = read(tmp_path, "t,q,tau\n0,1,2\n1,,3\n2,NaN,4\n3,n/a,5\n4,-,6\n5,oops,7\n6,1,8\n7,2,9\n8,3,1\n")
    assert np.isnan(stream.fields["q"]).tolist() == [False, True, True, True, True, True, False, False, False]
    assert notes == ("column 'q': 1 cells are no number",)


def test_text_is_left_out_truth_and_dates_are_numbers(tmp_path):
    rows = [f"2024-03-01 10:00:0{i}.5,{'run' if i else 'stop'},{i > 1},{i}" for i in range(4)]
    stream, notes = read(tmp_path, "\n".join(["stamp,mode,on,q", *rows]))
    assert list(stream.fields) == ["stamp", "on", "q"] and notes == ("columns of text left out: mode",)
    np.testing.assert_allclose(np.diff(stream.fields["stamp"]), 1.0)
    assert stream.fields["stamp"][0] == pytest.approx(1709287200.5) and stream.units["stamp"] == "s"
    assert stream.fields["on"].tolist() == [0.0, 0.0, 1.0, 1.0]


def test_names_that_are_blank_or_there_twice(tmp_path):
    stream, _ = read(tmp_path, "t,q,q,\n0,1,2,3\n1,2,3,4\n2,3,4,5\n")
    assert list(stream.fields) == ["t", "q", "q (2)", "column3"]
    stream, notes = read(tmp_path, "0,1\n1,2\n2,3\n")
    assert list(stream.fields) == ["column0", "column1"] and "no header" in notes[0]


def test_a_row_that_was_cut_is_dropped_with_a_note(tmp_path):
    stream, notes = read(tmp_path, PLAIN + "\n".join(ROWS * 5) + "\n0.4,1.")
    assert len(stream.fields["t"]) == 24 and notes == ("1 rows dropped that have not 3 cells",)


@pytest.mark.parametrize(
    ("text", "part"),
    [
        (b"", "is empty"),
        (b"\x00\x01\x02" * 50, "not text"),
        ("t,q,tau\n", "no row of numbers"),
        ("hello world\n", "no row of numbers"),
        ("t,q,dq,tau\n" + "\n".join(ROWS), "the header has 4 names, the rows have 3 cells"),
        ("t,q\n" + "\n".join(ROWS), "the header has 2 names, the rows have 3 cells"),
        ("t,q,tau\n" + "\n".join([*ROWS, "1,2", "1", "3,4,5,6"]), "rows have not 3 cells"),
    ],
)
def test_what_is_no_table_is_refused(tmp_path, text, part):
    with pytest.raises(ImportLogError, match=part) as caught:
        read(tmp_path, text)
    assert caught.value.file and caught.value.fix and "\n" not in str(caught.value)


def test_an_integer_column_that_turns_into_a_fraction_late(tmp_path):
    """Types told from the first rows alone would fail at the last one."""
    rows = [f"{i},1" for i in range(300_000)] + ["300000,1.5"]
    stream, _ = read(tmp_path, "t,q\n" + "\n".join(rows))
    assert stream.fields["q"][-1] == 1.5 and len(stream.fields["q"]) == 300_001


def test_dat_files_that_are_not_text_are_left_to_others(tmp_path):
    text, binary = tmp_path / "a.dat", tmp_path / "b.dat"
    text.write_text(PLAIN)
    binary.write_bytes(b"MDF     4.10\0\0\0\0" + bytes(200))
    assert CsvReader.claims_file(text) and not CsvReader.claims_file(binary)


@pytest.mark.parametrize("end", [";", ","])
def test_one_number_and_a_sign_a_row_is_one_column(tmp_path, end):
    stream, notes = read(tmp_path, "".join(f"{value}{end}\n" for value in Q), "q.txt")
    assert list(stream.fields) == ["column0"]
    np.testing.assert_array_equal(stream.fields["column0"], Q)
    assert f"'{end}' at the end of rows skipped" in notes


def test_a_delimiter_at_the_end_of_rows_without_header_makes_no_column(tmp_path):
    stream, _ = read(tmp_path, "\n".join(row.replace(",", "\t") + "\t" for row in ROWS))
    assert list(stream.fields) == ["column0", "column1", "column2"]


def test_a_second_column_without_values_is_none_to_be_cut(tmp_path):
    stream, _ = read(tmp_path, "t;q\n0.0;\n0.1;\n0.2;1.5\n")
    np.testing.assert_array_equal(stream.fields["q"], [np.nan, np.nan, 1.5])


def test_a_recorder_with_settings_a_row_of_labels_and_one_of_units(tmp_path):
    """As the oscilloscopes of one maker write it: each channel with a column of times."""
    head = "Timestamp,2020-03-16 17:04:51,Timestamp,2020-03-16 17:04:51\nInterval,0.1,Interval,0.1\n"
    names = 'Channel name,"Force",Channel name,"Input 1"\nUnit,"N",Unit,"V"\n'
    rows = "".join(f"{t},{q},{t},{tau}\n" for t, q, tau in zip(T, Q, TAU, strict=True))
    stream, _ = read(tmp_path, head + names + rows)
    assert list(stream.fields) == ["Channel name", "Force", "Channel name (2)", "Input 1"]
    assert stream.units == {"Force": "N", "Input 1": "V"}
    np.testing.assert_array_equal(stream.fields["Force"], Q)
