"""A demonstration's folder: it is read as it was written, and appears completely or not at all."""

import importlib.util
import math
import shutil
import tempfile
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from pbd.data import Contact, Demonstration, GraspedObject, GripEvent, Known, Place, Recording, RecordingInfo, Truth
from pbd.data.world import REACH_M
from pbd.errors import PbdWarning, RecordingError
from pbd.files import demo as demo_file
from pbd.files.demo import demo_folder, load_demo, newest_demo, read_demo, shell_word, write_demo
from pbd.files.find_by_name import bundled
from pbd.files.set_aside_demos import why_kept
from pbd.io.atomic import atomic_folder
from pbd.pose import Array, quat_exp
from pbd.simulation.calibration_tasks import CALIBRATION_TASKS
from pbd.simulation.simulate import simulate
from pbd.simulation.tasks import TASKS
from tests.system_failures import as_a_user, no_space

HALF_A_DIGIT = {"t": 5e-7, "gyr": 5e-8, "acc": 5e-7, "mag": 5e-5, "device_rpy": 5e-7, "p": 5e-7, "wxyz": 5e-9}
"""Rounding error of imu.csv and truth.csv, whose numbers of decimals are fixed."""


def assert_rounded(read: Array | None, written: Array | None, what: str) -> None:
    assert (read is None) == (written is None), what
    if read is not None and written is not None:
        assert_allclose(read, written, rtol=1e-12, atol=1.001 * HALF_A_DIGIT[what], err_msg=what)


def assert_same_arrays(read: Demonstration, written: Demonstration) -> None:
    """Compare all arrays, with NaN at the same places."""
    for channel in ("t", "acc", "gyr", "mag"):
        assert_rounded(getattr(read.recording, channel), getattr(written.recording, channel), channel)
    ours, theirs = read.recording.device_rpy, written.recording.device_rpy
    assert (ours is None) == (theirs is None)
    if ours is not None and theirs is not None:  # angles may differ by full turns
        assert_rounded(theirs + np.angle(np.exp(1j * (ours - theirs))), theirs, "device_rpy")
    assert (read.truth is None) == (written.truth is None)
    if read.truth is not None and written.truth is not None:
        assert_rounded(read.truth.t, written.truth.t, "t")
        assert_rounded(read.truth.p_nav_sensor, written.truth.p_nav_sensor, "p")
        assert_rounded(read.truth.wxyz_nav_sensor, written.truth.wxyz_nav_sensor, "wxyz")


# --- written and read -------------------------------------------------------------------------------------------------

words = st.text(st.characters(exclude_categories=["Cs"]), max_size=20).filter(lambda text: text == "" or text.strip())
sizes = st.floats(1e-3, 1.0)
objects = (
    st.builds(GraspedObject, st.just("box"), st.tuples(sizes, sizes, sizes), st.none() | sizes)
    | st.builds(GraspedObject, st.just("cylinder"), st.tuples(sizes, sizes))
    | st.builds(GraspedObject, st.just("sphere"), st.tuples(sizes))
)
metres = st.floats(-REACH_M, REACH_M)
sigmas = st.none() | st.floats(1e-6, 1.0)
instants = st.lists(st.floats(0.0, 1e4), min_size=2, max_size=4, unique=True).map(tuple)
places = st.builds(Place, instants, st.none() | st.tuples(metres, metres, metres), sigmas)
contacts = instants.flatmap(
    lambda t: (
        st.builds(Contact, st.just(t[0]), st.none() | st.just(t[1]), st.none(), sigmas)
        | st.builds(Contact, st.just(t[0]), st.none(), metres, sigmas)
    )
)
events = st.builds(GripEvent, st.integers(0, 10**5).map(lambda t: t / 1e4), st.booleans())


@st.composite
def demonstrations(draw: st.DrawFn) -> Demonstration:
    n = draw(st.integers(2, 12))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))

    def channel(scale: float) -> Array:
        values = scale * rng.normal(size=(n, 3))
        values[rng.random(n) < draw(st.sampled_from((0.0, 0.3, 1.0)))] = np.nan
        return values

    t = np.concatenate(([0.0], np.cumsum(rng.uniform(0.001, 0.1, n - 1))))
    recording = Recording(
        t=t,
        acc=channel(10.0),
        gyr=channel(1.0) if draw(st.booleans()) else None,
        mag=channel(50.0) if draw(st.booleans()) else None,
        device_rpy=channel(2.0) if draw(st.booleans()) else None,
        grip=tuple(draw(st.lists(events, max_size=3))),
        info=RecordingInfo(
            name="demo",
            sensor=draw(words) or "unknown",
            rate_hz=draw(st.integers(1, 10**6)) / 1e3,
            created=draw(st.none() | st.just("2026-01-02T03:04:05Z")),
        ),
    )
    truth = Truth(t, channel(1.0), quat_exp(rng.normal(size=(n, 3))))
    return Demonstration(
        recording=recording,
        truth=truth if draw(st.booleans()) else None,
        notes=draw(words),
        bundled=draw(st.booleans()),
        closed=draw(st.booleans()),
        failed=draw(st.booleans()),
        places=tuple(draw(st.lists(places, max_size=2))),
        contacts=tuple(draw(st.lists(contacts, max_size=2))),
        grasped=draw(st.none() | objects),
    )


@settings(max_examples=40, deadline=None)
@given(demonstrations())
def test_a_demonstration_is_read_as_written(written: Demonstration) -> None:
    with tempfile.TemporaryDirectory() as parent:
        folder = Path(parent) / "demo"
        write_demo(written, folder)
        read = read_demo(folder)
    assert_same_arrays(read, written)
    assert read.recording.info == written.recording.info
    assert read.recording.grip == written.recording.grip
    for field in ("notes", "bundled", "closed", "failed", "places", "contacts", "known", "grasped"):
        assert getattr(read, field) == getattr(written, field)
    assert read.folder == folder


def still(n: int = 3, **info: Any) -> Demonstration:
    recording = Recording(np.arange(n) / 10.0, np.tile((0.0, 0.0, 9.81), (n, 1)), info=RecordingInfo(**info))
    return Demonstration(recording)


def test_the_folder_names_the_demonstration_and_the_rate_is_measured(tmp_path: Path) -> None:
    write_demo(still(name="run7"), tmp_path / "tea")
    info = read_demo(tmp_path / "tea").recording.info
    assert (info.name, info.rate_hz) == ("tea", 10.0)
    (tmp_path / "tea").rename(tmp_path / "coffee")
    assert read_demo(tmp_path / "coffee").recording.info.name == "coffee"


@pytest.mark.parametrize(
    "demo",
    [replace(still(), notes=" "), still(sensor=""), still(1), still(rate_hz=1e-4)],
    ids=["blank notes", "no sensor", "one sample", "slow"],
)
def test_whatever_is_written_can_be_read(demo: Demonstration, tmp_path: Path) -> None:
    write_demo(demo, tmp_path / "tea")
    read_demo(tmp_path / "tea")


# --- completely or not at all -----------------------------------------------------------------------------------------


def test_an_existing_folder_is_refused_unless_forced(tmp_path: Path) -> None:
    folder = tmp_path / "tea"
    write_demo(still(3), folder)
    with pytest.raises(RecordingError, match=r"tea exists; give another name, or --force to replace it$"):
        write_demo(still(5), folder)
    assert len(read_demo(folder).recording) == 3
    with pytest.warns(PbdWarning):
        write_demo(still(5), folder, force=True)
    assert len(read_demo(folder).recording) == 5


@pytest.mark.parametrize("sensor", ["simulated modern", "sim (x-IMU3)"])
def test_force_removes_what_is_simulated(tmp_path: Path, sensor: str) -> None:
    write_demo(still(3, sensor=sensor), tmp_path / "tea")
    write_demo(still(5), tmp_path / "tea", force=True)
    assert [path.name for path in tmp_path.iterdir()] == ["tea"]


def test_force_removes_what_is_the_same(tmp_path: Path) -> None:
    for day in "123":
        write_demo(still(created=f"2026-01-0{day}T03:04:05Z"), tmp_path / "tea", force=True)
    assert [path.name for path in tmp_path.iterdir()] == ["tea"]


@pytest.mark.parametrize(
    ("sensor", "file", "why"),
    [
        ("witmotion", "", "a recording"),
        ("simulated modern", "keyframes.toml", "whose keyframes were edited"),
        ("simulated modern", "notes.txt", "with notes.txt in it"),
        ("simulated modern", "demo.toml", "whose demo.toml was edited"),
    ],
)
def test_force_keeps_what_a_person_made(tmp_path: Path, sensor: str, file: str, why: str) -> None:
    folder = tmp_path / "tea"
    write_demo(still(3, sensor=sensor), folder)
    if file:
        with (folder / file).open("a") as opened:
            opened.write("[[contact]]\nt_s = 0.1\n")
    files = {path.name: path.read_bytes() for path in folder.iterdir()}
    with pytest.warns(PbdWarning, match=rf"the old .*tea, {why}, is kept in .*tea\.before$"):
        write_demo(still(5, sensor=sensor), folder, force=True)
    assert len(read_demo(folder).recording) == 5
    assert {path.name: path.read_bytes() for path in (tmp_path / "tea.before").iterdir()} == files


@pytest.mark.parametrize("task", [*TASKS, *CALIBRATION_TASKS])
def test_what_a_simulation_writes_is_no_edit(tmp_path: Path, task: str) -> None:
    write_demo(simulate(task, "phone", 3), tmp_path / "tea")
    assert why_kept(tmp_path / "tea") == ""


@pytest.mark.parametrize(
    ("written", "edited"),
    [
        ("dock.", "dock. The lid was loose."),
        ('"Simulated (', '"A good one. Simulated ('),
        ("size = [0.06, 0.2]", "size = [0.07, 0.2]"),
        ("size = [0.06, 0.2]", "size = [0.06, 0.2]\nmass_kg = 0.4"),
        ("closed = true", "closed = true # it did not end there"),
    ],
)
def test_an_edit_of_a_simulated_demonstration_is_seen(tmp_path: Path, written: str, edited: str) -> None:
    folder = tmp_path / "tea"
    write_demo(simulate("pour", "modern", 0), folder)
    text = (folder / "demo.toml").read_text(encoding="utf-8")
    assert written in text
    (folder / "demo.toml").write_text(text.replace(written, edited, 1), encoding="utf-8")
    assert why_kept(folder) == "whose demo.toml was edited"


def test_a_folder_that_another_program_makes_meanwhile_stays(tmp_path: Path) -> None:
    def race(folder: Path) -> None:
        with atomic_folder(folder, replace=False) as new:
            (new / "mine").touch()
            folder.mkdir()
            (folder / "theirs").touch()

    with pytest.raises(RecordingError, match=r"can't be written \(another program made it meanwhile\)"):
        race(tmp_path / "tea")
    assert [file.name for file in tmp_path.rglob("*")] == ["tea", "theirs"]


def test_force_replaces_nothing_but_a_demonstration(tmp_path: Path) -> None:
    write_demo(still(), tmp_path / "demos" / "tea")
    with pytest.raises(RecordingError):
        write_demo(still(), tmp_path / "demos", force=True)
    assert read_demo(tmp_path / "demos" / "tea")


def test_a_failed_write_leaves_the_old_demonstration(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "tea"
    write_demo(still(3), folder)
    monkeypatch.setattr(demo_file, "write_table", no_space)
    with pytest.raises(RecordingError, match=r"tea can't be written \(.*No space left.*\); give another place$"):
        write_demo(still(5), folder, force=True)
    assert len(read_demo(folder).recording) == 3
    with pytest.raises(RecordingError):
        write_demo(still(5), tmp_path / "coffee")
    assert [path.name for path in tmp_path.iterdir()] == ["tea"]


def test_a_read_only_demonstration_is_not_replaced(tmp_path: Path) -> None:
    write_demo(still(3), tmp_path / "tea")
    (tmp_path / "tea").chmod(0o555)
    with as_a_user(), pytest.raises(RecordingError, match="tea is read-only; change its permissions, or give another"):
        write_demo(still(5), tmp_path / "tea", force=True)


def test_what_is_left_of_the_old_folder_is_said(tmp_path: Path) -> None:
    locked = tmp_path / "tea" / "locked"
    locked.mkdir(parents=True)
    (locked / "old").touch()
    locked.chmod(0o555)
    said = (
        r"tea is replaced, but what is left of the old one is in .*tea\.before: it can't be removed \(Permission denied"
    )
    with as_a_user(), pytest.warns(PbdWarning, match=said), atomic_folder(tmp_path / "tea") as new:
        (new / "mine").touch()
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["locked", "mine", "old", "tea", "tea.before"]


def test_a_new_folder_that_vanishes_leaves_the_old_one(tmp_path: Path) -> None:
    write_demo(still(3), tmp_path / "tea")
    with pytest.raises(RecordingError, match="can't be written"), atomic_folder(tmp_path / "tea") as new:
        new.rmdir()
    assert len(read_demo(tmp_path / "tea").recording) == 3
    assert [path.name for path in tmp_path.iterdir()] == ["tea"]


def test_a_file_at_the_path_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine")
    with pytest.raises(RecordingError, match="can't be written"):
        write_demo(still(), tmp_path / "file" / "tea")
    with pytest.raises(RecordingError, match="can't be written"):
        write_demo(still(), tmp_path / "file", force=True)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
    assert (tmp_path / "file").read_text() == "mine"


# --- demo.toml --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("nots = 'x'", ":1: nots is unknown; the keys here are format, name, sensor, "),
        ("grip = [{t_s = 1.0}]", ":1: [grip] closed is missing; add it"),
        (
            "created = 'today'",
            ":1: created must be a date and time such as 2026-05-01T12:00:00Z, got 'today'; correct it",
        ),
        ("object = {shape = 'sphere', size = [1], mass_kg = 0}", ":1: [object] mass_kg must be above zero, got 0"),
        ("object = {shape = 'sphere', size = [-1]}", ":1: [object] size must hold only numbers above zero, got [-1]"),
    ],
)
def test_a_fault_in_demo_toml_is_named_with_its_line(tmp_path: Path, line: str, message: str) -> None:
    write_demo(still(), tmp_path / "tea")
    file = tmp_path / "tea" / "demo.toml"
    file.write_text(f"{line}\n{file.read_text()}")
    with pytest.raises(RecordingError) as caught:
        read_demo(tmp_path / "tea")
    assert caught.value.message.startswith(f"{file}{message}")


def test_a_date_may_stand_without_quotes(tmp_path: Path) -> None:
    """TOML has a type of its own for dates, which a person who edits the file may use."""
    write_demo(still(), tmp_path / "tea")
    file = tmp_path / "tea" / "demo.toml"
    file.write_text(f"created = 2026-05-01T12:00:00Z\n{file.read_text()}")
    assert read_demo(tmp_path / "tea").recording.info.created == "2026-05-01T12:00:00+00:00"


KNOWN = """
closed = true

[[place]]
t_s = [2.0, 6.5]

[[place]]
t_s = [4.0]
position_m = [0.45, 0.1, 0.12]
sigma_m = 0.005

[[contact]]
t_s = 5.2

[[contact]]
t_s = 7.9
as_at_s = 2.0

[[contact]]
t_s = 9.0
height_m = 0.12
"""


def write_known(folder: Path, known: str) -> Path:
    """Write a demonstration and append to its demo.toml, which has seven lines; return the file."""
    write_demo(still(created="2026-01-02T03:04:05Z", rate_hz=10.0), folder)
    file = folder / "demo.toml"
    file.write_text(file.read_text() + known)
    return file


def test_places_and_heights_are_read_as_documented(tmp_path: Path) -> None:
    write_known(tmp_path / "tea", KNOWN)
    demo = read_demo(tmp_path / "tea")
    assert demo.known == Known(
        closed=True,
        places=(Place((2.0, 6.5)), Place((4.0,), (0.45, 0.1, 0.12), sigma_m=0.005)),
        contacts=(Contact(5.2), Contact(7.9, as_at=2.0), Contact(9.0, height=0.12)),
    )
    page = (Path(__file__).parents[2] / "docs" / "known-places.md").read_text()
    for line in filter(None, KNOWN.splitlines()):
        assert line in page
    write_demo(demo, tmp_path / "copy")
    assert read_demo(tmp_path / "copy").known == demo.known


@pytest.mark.parametrize(
    ("known", "message"),
    [
        (
            "[[place]]\nt_s = [2.0]\n",
            ":7: [place] t_s must name at least two stops, or one and a position_m; correct it",
        ),
        ("[[place]]\nt_s = [2.0, 2.0]\n", ":7: [place] t_s must name each stop once; correct it"),
        (
            "[[place]]\nt_s = [1.0, 2.0]\n[[place]]\nt_s = [2.0, 3.0]\nposition_m = [1, 2]\n",
            ":10: [place] position_m must have 3 numbers, got 2; correct it",
        ),
        *(
            (text, f":{line} has {far} m, beyond any arm's reach; give metres, not cm or mm")
            for text, line, far in (
                ("[[place]]\nt_s = [1.0]\nposition_m = [450, -150, 250]\n", "8: [place] position_m", 450),
                ("[[contact]]\nt_s = 1.0\nheight_m = -20\n", "8: [contact] height_m", -20),
                ('[object]\nshape = "sphere"\nsize = [60]\n', "8: [object] size", 60),
            )
        ),
        (
            "[[place]]\nt_s = [1.0, 2.0]\nsigma_m = 0\n",
            ":8: [place] sigma_m must be above zero, got 0; correct it",
        ),
        (
            "[[contact]]\nt_s = 1.0\nas_at_s = 1.0\n",
            ":7: [contact] t_s and as_at_s must be two stops; correct it",
        ),
        (
            "[[contact]]\nt_s = 1.0\nas_at_s = 2.0\nheight_m = 0.1\n",
            ":7: [contact] t_s takes as_at_s or height_m, not both; correct it",
        ),
    ],
)
def test_a_fault_in_a_place_or_a_height_is_named_with_its_line(tmp_path: Path, known: str, message: str) -> None:
    file = write_known(tmp_path / "tea", known)
    with pytest.raises(RecordingError) as caught:
        read_demo(tmp_path / "tea")
    assert caught.value.message == f"{file}{message}"


# --- names ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["", "..", "~", "-f"])
def test_what_can_be_no_demonstrations_name_is_refused(name: str) -> None:
    with pytest.raises(RecordingError, match="can't be a demonstration's name"):
        demo_folder(name)


def record(name: str, created: str | None, is_bundled: bool = False) -> None:
    write_demo(replace(still(created=created), bundled=is_bundled), demo_folder(name))


@pytest.mark.usefixtures("elsewhere")
def test_the_newest_is_the_one_recorded_last() -> None:
    assert newest_demo() == "pouring"
    record("copied", "2026-09-01T00:00:00Z", is_bundled=True)
    assert newest_demo() == "pouring"  # bundled ones come last, whatever their dates
    record("undated", None)
    assert newest_demo() == "undated"
    record("b", "2026-05-02T00:00:00Z")
    record("a", "2026-05-03T00:00:00Z")
    record("c", "2025-12-31T23:59:59Z")
    assert newest_demo() == "a"
    record("west", "2026-05-02T23:00:00-05:00")  # 4 o'clock in UTC
    assert newest_demo() == "west"
    shutil.rmtree(demo_folder("west"))
    record("a.before", "2026-05-04T00:00:00Z")
    record("a.new-2", "2026-05-04T00:00:00Z")
    write_demo(replace(still(created="2026-05-05T00:00:00Z"), failed=True), demo_folder("short"))
    assert newest_demo() == "a"
    assert newest_demo(failed=True) == "short"
    (Path("demos") / "a" / "demo.toml").write_text("not a demonstration")
    assert newest_demo() == "b"


@pytest.mark.usefixtures("elsewhere")
def test_a_demonstration_is_a_name_a_folder_or_a_file() -> None:
    record("tea", None)
    assert demo_folder("tea") == Path("demos/tea")
    assert demo_folder("other/tea") == Path("other/tea")
    assert demo_folder("./tea") == demo_folder("tea/") == Path("tea")  # as `load_demo` reads a path with a slash
    assert shell_word(Path("tea")) == "./tea"
    for name in ("tea", "demos/tea"):
        assert load_demo(name).recording.info.name == "tea"
    assert load_demo("demos/tea/imu.csv").recording.info.name == "imu"
    assert load_demo("pouring").bundled


# --- bundled ----------------------------------------------------------------------------------------------------------


def make_py() -> ModuleType:
    spec = importlib.util.spec_from_file_location("make_demos", bundled("demos") / "make.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_bundled_demonstration_is_made_by_make_py() -> None:
    folders = {path.parent.name for path in bundled("demos").glob("*/demo.toml")}
    assert folders == set(make_py().BUNDLED)


@pytest.mark.parametrize("name", make_py().BUNDLED)
def test_make_py_makes_what_is_bundled(name: str) -> None:
    made = make_py().make(name)
    read = read_demo(bundled("demos") / name)
    assert_same_arrays(read, made)
    assert read.recording.info == made.recording.info
    assert read.recording.grip == tuple(replace(event, t=round(event.t, 4)) for event in made.recording.grip)
    assert (read.notes, read.closed, read.grasped) == (made.notes, made.closed, made.grasped)
    assert read.bundled
    assert "simulated" in read.notes.lower()
    assert not math.isnan(read.recording.acc.sum())
