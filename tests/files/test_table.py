import csv
import warnings
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from pbd.errors import PbdWarning, RecordingError
from pbd.files.table import open_sheet, write_table


def table_file(folder: Path, content: str | bytes) -> Path:
    path = folder / "table.csv"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


@pytest.mark.parametrize(
    "content",
    [
        "t,ax\n0,1.5\n0.1,-2e-3\n",
        "t,ax\n0,1.5\n0.1,-2e-3",  # no line end at the end
        "t,ax\r\n0,1.5\r\n0.1,-2e-3\r\n",
        "\ufefft,ax\n0,1.5\n0.1,-2e-3\n",  # a byte order mark, as spreadsheets write it
        "t;ax\n0;1.5\n0.1;-2e-3\n",
        "t\tax\n0\t1.5\n0.1\t-2e-3\n",
        ' t , "ax"\n 0 , 1.5\n\n0.1, -2e-3\n',
        't,ax\n"0","1.5"\n"0.1","-2e-3"\n',
    ],
)
def test_delimiters_line_ends_and_quotes(tmp_path: Path, content: str) -> None:
    table = open_sheet(table_file(tmp_path, content)).read()
    assert table.header == ("t", "ax")
    assert_array_equal(table.values, [[0.0, 1.5], [0.1, -2e-3]])
    assert_array_equal(table.columns("ax", "t"), [[1.5, 0.0], [-2e-3, 0.1]])


@pytest.mark.parametrize("cut", ["0.2", "0", "-", "0.\0\0\0"])
def test_a_last_row_that_a_lost_power_cut_off_is_left_out(tmp_path: Path, cut: str) -> None:
    with pytest.warns(PbdWarning, match=r"table.csv: the last row is cut off, and left out: it has no line end"):
        table = open_sheet(table_file(tmp_path, f"t,ax\n0,1.5\n0.1,-2e-3\n{cut}")).read()
    assert_array_equal(table.values, [[0.0, 1.5], [0.1, -2e-3]])


def test_an_empty_cell_is_nan(tmp_path: Path) -> None:
    table = open_sheet(table_file(tmp_path, "t,ax,ay\n0,,1\n1, ,2\n2,3,\n")).read()
    assert_array_equal(table.values, [[0, np.nan, 1], [1, np.nan, 2], [2, 3, np.nan]])


@pytest.mark.parametrize(
    ("content", "message", "fields"),
    [
        ("", ": the file is empty; it needs a header line and rows of numbers", {}),
        ("t,ax\n", ": a header but no rows; record again", {}),
        ("t,ax\n\0\0", ": a header but no rows; record again", {}),
        (
            f"t,a{' ' * 20_000}x\n0,1\n",  # patterns would take minutes
            ":1: the header can't be read (a name of more than 1000 characters); give a CSV file",
            {"line": 1},
        ),
        (
            f"{'a,' * 20_000}t\n0,1\n",
            ":1: the header can't be read (20001 columns, more than the 16384 that are read); give a CSV file",
            {"line": 1},
        ),
        (
            f"t,{'a' * 200_000}\n0,1\n",
            ":1: the header can't be read (field larger than field limit (131072)); give a CSV file",
            {"line": 1},
        ),
        ("t,ax,t\n0,1,2\n", ": the column 't' is there twice; rename one", {"value": "t"}),
        (
            "t,ax\n0,1\n1,two\n",
            ":3: 'two' in column 'ax' is not a number; correct the cell, or leave it empty",
            {"line": 3, "column": "ax", "value": "two"},
        ),
        (
            "t,ax\n0,00,1,50\n0,01,2,50\n",
            ":2: 4 cells where the header has 2, because commas are both its decimal marks and between its cells; "
            "export it again with decimal points, or with semicolons between the cells",
            {"line": 2, "value": 4, "bound": 2},
        ),
        (
            "t;ax\n0;1\n1;2,5\n",  # a decimal comma
            ":3: '2,5' in column 'ax' is not a number; it has a decimal comma: write numbers with a point (export it "
            "again, or put a point for each comma)",
            {"line": 3, "column": "ax", "value": "2,5"},
        ),
        (
            "t,ax\n0,1\n\n1\n",
            ":4: 1 cell where the header has 2; correct or remove the line",
            {"line": 4, "value": 1, "bound": 2},
        ),
        (
            "t,ax\n0,1,2\n1,2,3\n",  # consistently one too many
            ":2: 3 cells where the header has 2, as in the lines below; name each column in the header",
            {"line": 2, "value": 3, "bound": 2},
        ),
        (
            "t,ax\n0,1,2\n1,2\n",
            ":2: 3 cells where the header has 2; correct or remove the line",
            {"line": 2, "value": 3, "bound": 2},
        ),
        (
            't,ax\n0,1\n"1,2\n2,3\n',  # a quote that nothing closes
            ":3: 1 cell where the header has 2; correct or remove the line",
            {"line": 3, "value": 1, "bound": 2},
        ),
        (
            't,ax\n0,1\n"1,2\n' + "2,3\n" * 50_000,
            ":3: field larger than field limit (131072); mend or remove the line",
            {"line": 3},
        ),
        (bytes(1000), ": can't be read as text (NUL bytes, as a crash may leave); give a CSV file", {}),
        (b"t,ax\n0,\xff\n", ": can't be read as text (tried utf-8; byte 7 does not fit)", {}),
    ],
)
def test_a_fault_is_named_with_its_line_and_column(
    tmp_path: Path, content: str | bytes, message: str, fields: dict[str, object]
) -> None:
    path = table_file(tmp_path, content)
    with pytest.raises(RecordingError) as caught:
        open_sheet(path).read()
    assert caught.value.message.startswith(f"{path}{message}")
    assert caught.value.fields == {"path": path, **fields}


def test_a_line_of_units_counts_as_a_line(tmp_path: Path) -> None:
    path = table_file(tmp_path, "t,ax,ay,az\ns,g,g,g\n0,1,2,3\n1,1,2,x\n")
    with pytest.raises(RecordingError, match=r":4: 'x' in column 'az \(g\)' is not a number"):
        open_sheet(path, foreign=True).read()


def test_the_error_of_a_missing_column_lists_the_columns(tmp_path: Path) -> None:
    table = open_sheet(table_file(tmp_path, "t,ax\n0,1\n")).read()
    with pytest.raises(RecordingError, match=r"no column 'ay'; the columns are t, ax$") as caught:
        table.columns("t", "ay")
    assert caught.value.fields["value"] == "ay"


@pytest.mark.parametrize("hole", [np.nan, 1.0])
def test_a_table_is_read_as_written(tmp_path: Path, hole: float) -> None:
    path = tmp_path / "table.csv"
    values = np.array([[0.0, -1.25], [0.123456789, hole]])
    write_table(path, ("t", "ax"), values, (3, 2))
    assert path.read_text().splitlines()[:2] == ["t,ax", "0.0,-1.25"]
    assert_array_equal(open_sheet(path).read().values, [[0.0, -1.25], [0.123, hole]])


def test_a_value_near_the_largest_number_is_written_as_an_empty_cell(tmp_path: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        write_table(tmp_path / "table.csv", ("t", "ax"), np.array([[0.0, 1e308]]), (3, 2))
    assert (tmp_path / "table.csv").read_text() == "t,ax\n0.0,\n"


def test_names_may_have_any_character(tmp_path: Path) -> None:
    names = ("t", "a,b", 'a"b', "a\rb", "a\nb", "a;b", "\u00e4")
    write_table(tmp_path / "table.csv", names, np.zeros((1, len(names))))
    with (tmp_path / "table.csv").open(encoding="utf-8", newline="") as file:
        assert next(csv.reader(file)) == list(names)


def test_a_header_of_quotes_alone_is_one_name(tmp_path: Path) -> None:
    assert open_sheet(table_file(tmp_path, '""""\n1\n'), foreign=True).header == ("column 1",)
