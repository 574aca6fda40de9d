"""Files of points: the unit must be known."""

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from pbd.errors import CalibrationError
from pbd.files.points import points_csv, read_points


def write(folder: Path, text: str) -> Path:
    path = folder / "points.csv"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("text", "unit"),
    [
        ("name,x_m,y_m,z_m\nA,0.3,-0.2,0\nB,0.5,0.1,0.02\n", None),
        ("z_mm;y_mm;x_mm;name\n# the corner\n0;-200;300;A\n\n20;100;500;B\n", None),
        ("\ufeffname\tX_cm\tY_cm\tZ_cm\nA\t30\t-20\t0\nB\t50\t10\t2\n", None),
        ("name,x,y,z\nA,300,-200,0\nB,500,100,20\n", "mm"),
        ("Punkt;x (mm);y (mm);z (mm)\nA;300,0;-200,0;0\nB;500;100;20,0\n", None),
        ("Ecke;X [cm];Y [cm];Z [cm];Bemerkung\nA;30,0;-20;0;links\nB;50;10;2;\n", None),
        ("Teil 7, gemessen am 3.11.\n\nNr.\tx/mm\ty/mm\tz/mm\nA\t300,0\t-200\t0\nB\t500\t100\t20\n", None),
        ("Punkt;x in m;y in m;z in m\nA;0,3;-0,2;0\nB;0,5;0,1;0,02\n", None),
        ("P;x;y;z\n;(mm);(mm);(mm)\nA;300,0;-200,0;0\nB;500;100;20,0\n", None),
    ],
)
def test_units_become_metres(tmp_path: Path, text: str, unit: str | None) -> None:
    points = read_points(write(tmp_path, text), unit)
    assert list(points) == ["A", "B"]
    assert_allclose(list(points.values()), [[0.3, -0.2, 0.0], [0.5, 0.1, 0.02]])


def test_points_between_thousands_are_no_decimal_marks(tmp_path: Path) -> None:
    points = read_points(write(tmp_path, "Punkt;x (mm);y (mm);z (mm)\nA;1.250;-200,5;0\nB;1.000,5;100;20\n"))
    assert_allclose(list(points.values()), [[1.25, -0.2005, 0.0], [1.0005, 0.1, 0.02]])
    points = read_points(write(tmp_path, "Punkt;x (mm);y (mm);z (mm)\nA;1.250;-200.5;0\nB;1000.5;100;20\n"))
    assert_allclose(list(points.values()), [[0.00125, -0.2005, 0.0], [1.0005, 0.1, 0.02]])


def test_a_unit_that_the_columns_contradict_is_refused(tmp_path: Path) -> None:
    path = write(tmp_path, "x_mm,y_mm,z_mm\n0,0,0\n1,0,0\n")
    assert read_points(path, "mm")["2"][0] == 0.001
    with pytest.raises(CalibrationError, match="the columns are in mm, as their names say; leave --unit out"):
        read_points(path, "cm")


def test_points_without_names_are_numbered(tmp_path: Path) -> None:
    assert list(read_points(write(tmp_path, "x_m,y_m,z_m\n0,0,0\n1,0,0\n"))) == ["1", "2"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x,y,z\n0,0,0\n", ": the unit of x, y, z is not known; name the columns x_m,y_m,z_m"),
        ("x_in,y_in,z_in\n0,0,0\n", ": the columns are x_in, y_in, z_in; they must be x_m, y_m and z_m"),
        ("0.1,0.2,0.3\n0,0,0\n", ": the columns are 0.1, 0.2, 0.3; they must be x_m, y_m and z_m"),
        ("Punkt;x (mm);y (cm);z (mm)\nA;0,5;0;0\n", ": the columns are Punkt, x (mm), y (cm), z (mm); they must be"),
        ("Punkt;x (mm);y (mm);z (mm)\nA;0,5;0;0\nB;1;1", ":3: 3 cells where the header has 4; correct or remove"),
        ("x_mm,y_mm,z_mm\n0,0,0\n1,1", ":3: 2 cells where the header has 3; correct or remove the line"),
        ("x_m,y_m,z_m\n0,0,0\n0,,0\n", ":3: '' in column 'y_m' is not a number; correct the cell"),
        ("x_m,y_m,z_m\n0,0,0\n0,nan,0\n", ": the point '2' lacks a coordinate; add it"),
        ("name,x_m,y_m,z_m\nA,300,0,0\n", ": the point 'A' is 300 m from the robot's base; is the unit right?"),
        ("name,x_m,y_m,z_m\nA,0,0,0\nA,1,0,0\n", ": two points are named 'A'; rename one"),
    ],
)
def test_a_fault_is_named_with_its_line(tmp_path: Path, text: str, message: str) -> None:
    path = write(tmp_path, text)
    with pytest.raises(CalibrationError) as caught:
        read_points(path)
    assert caught.value.message.startswith(f"{path}{message}")


@settings(max_examples=25)
@given(st.lists(st.tuples(*[st.floats(-9.9, 9.9)] * 3), min_size=1, max_size=5))
def test_points_are_read_as_written(tmp_path_factory: pytest.TempPathFactory, places: list[tuple[float, ...]]) -> None:
    path = tmp_path_factory.mktemp("points") / "points.csv"
    written = {f"P{k}": place for k, place in enumerate(places)}
    path.write_text(points_csv(written, "a remark, with a comma"), encoding="utf-8")
    read = read_points(path)
    assert list(read) == list(written)
    assert_allclose(list(read.values()), list(written.values()), atol=1e-5)
