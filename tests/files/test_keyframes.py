"""keyframes.toml: it is read as it was written, and a mistake is refused with its line."""

import warnings
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pbd.data import Keyframe, TouchUp
from pbd.errors import PbdError, PbdWarning, RecordingError, collected_warnings
from pbd.files.demo import read_demo, write_demo
from pbd.files.keyframes import keyframes_toml, read_keyframes, read_touch_ups, write_keyframes
from pbd.files.keyframes_edit import add_touch_up, set_frames
from pbd.pipeline import track
from pbd.pose import Pose, quat_exp
from pbd.simulation.simulate import simulate
from pbd.tracking.keyframes import find_keyframes

FOUND = find_keyframes(track(simulate("pour", "modern", 0).recording))


def edited(tmp_path: Path, old: str, new: str, count: int = 1) -> Path:
    """Write the found keyframes with a person's edit."""
    text = keyframes_toml("tea", FOUND, magnetic=True)
    assert old in text
    path = tmp_path / "keyframes.toml"
    path.write_text(text.replace(old, new, count), encoding="utf-8")
    return path


def line_of(path: Path, error: PbdError) -> str:
    """Return the text of the line that the error names."""
    line = error.fields["line"]
    assert isinstance(line, int)
    assert f"{path}:{line}:" in error.message
    return path.read_text(encoding="utf-8").splitlines()[line - 1]


def assert_same(read: tuple[Keyframe, ...], written: tuple[Keyframe, ...]) -> None:
    assert len(read) == len(written)
    for ours, theirs in zip(read, written, strict=True):
        shift, turn = ours.T_nav_sensor.distance(theirs.T_nav_sensor)
        assert shift < 1e-4
        assert turn < np.radians(0.0016)  # three angles, each rounded by 0.0005 degrees
        assert ours.t == pytest.approx(theirs.t, abs=5.1e-4)
        assert ours.dwell_s == pytest.approx(theirs.dwell_s, abs=0.0051)
        assert (ours.grip, ours.label) == (theirs.grip, theirs.label)
        np.testing.assert_allclose(np.sqrt(np.diagonal(ours.cov)), np.sqrt(np.diagonal(theirs.cov)), atol=1e-4)


def test_a_learned_tolerance_is_written_so_that_it_can_be_read(tmp_path: Path) -> None:
    learned = replace(FOUND[0], tolerance_m=np.array([1e-6, 0.7, 2e-5]), tolerance_rad=1e-6)
    (read, *_) = read_keyframes(write_keyframes(tmp_path, [learned, *FOUND[1:]], magnetic=True))
    assert read.tolerance_m == pytest.approx(np.array([1e-4, 0.5, 1e-4]))
    assert read.tolerance_rad == pytest.approx(np.radians(0.01))


def test_nudges_frames_and_touch_ups_are_read_as_written(tmp_path: Path) -> None:
    nudge = np.array([0.001, -0.002, 0.0])
    moved = (
        FOUND[0],
        replace(FOUND[1], nudge_base_m=nudge, nudge_tool_m=-nudge, frames=("lid", 'a "cup"'), label='"1" über\n'),
        *FOUND[2:],
    )
    touch_ups = (TouchUp(FOUND[1].t, nudge, only=True), TouchUp(FOUND[2].t, -nudge, undone=True))
    path = write_keyframes(tmp_path, moved, magnetic=True, touch_ups=touch_ups)
    read = read_keyframes(path)[1]
    assert (read.frames, read.label) == (("lid", 'a "cup"'), '"1" über\n')
    np.testing.assert_array_equal(read.nudge_base_m, nudge)
    np.testing.assert_array_equal(read.nudge_tool_m, -nudge)
    back = read_touch_ups(path)
    assert [(each.only, each.undone) for each in back] == [(True, False), (False, True)]
    np.testing.assert_array_equal([each.by_nav_m for each in back], [nudge, -nudge])
    assert [each.t for each in back] == [pytest.approx(each.t, abs=5e-4) for each in touch_ups]


@settings(max_examples=10)
@given(
    st.lists(
        st.tuples(
            st.floats(0.01, 5.0),
            st.floats(0.0, 3.0),
            st.tuples(*[st.floats(-2.0, 2.0)] * 3),
            st.tuples(*[st.floats(-3.0, 3.0)] * 3),
            st.sampled_from([True, False, None]),
            st.text(st.characters(codec="utf-8"), max_size=8).map(str.strip),
        ),
        min_size=1,
        max_size=5,
    )
)
def test_any_keyframes_are_read_as_written(
    tmp_path_factory: pytest.TempPathFactory, rows: list[tuple[object, ...]]
) -> None:
    t, keyframes, before = 0.0, list[Keyframe](), None
    for step, dwell, p, turn, grip, label in rows:
        if grip == before:
            grip = None  # two in a row are refused
        before = before if grip is None else grip
        t += step  # type: ignore[operator]
        position = np.array(p) if keyframes else np.zeros(3)
        pose = Pose(position, quat_exp(np.array(turn)))
        keyframes.append(Keyframe(t, dwell, pose, 1e-4 * np.eye(6), grip, label))  # type: ignore[arg-type]
    path = write_keyframes(tmp_path_factory.mktemp("any"), keyframes, magnetic=True)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        assert_same(read_keyframes(path), tuple(keyframes))
    first = next((keyframe.grip for keyframe in keyframes if keyframe.grip is not None), None)
    assert len(caught) == (first is False)


def test_a_first_grip_that_opens_is_warned_of_with_its_line(tmp_path: Path) -> None:
    path = edited(tmp_path, 'grip = "closes"\n', "")
    with pytest.warns(PbdWarning, match="it is open from the start: nothing changes there") as caught:
        keyframes = read_keyframes(path)
    (index,) = [k for k, keyframe in enumerate(keyframes) if keyframe.grip is not None]
    line = path.read_text(encoding="utf-8").splitlines().index('grip = "opens"') + 1
    assert str(caught[0].message).startswith(f"{path}:{line}: the grip opens at keyframe {index}, but")


@pytest.mark.parametrize("axis", range(3))
def test_a_keyframe_out_of_reach_is_refused_with_its_line(tmp_path: Path, axis: int) -> None:
    path = write_keyframes(tmp_path, FOUND, magnetic=True)
    place = np.where(np.arange(3) == axis, -44.0, 0.1).tolist()
    lines = path.read_text(encoding="utf-8").splitlines()
    third = [k for k, line in enumerate(lines) if line.startswith("position_m")][3]
    lines[third] = f"position_m = {place}"
    path.write_text("\n".join(lines), encoding="utf-8")
    with pytest.raises(
        RecordingError, match=r"position_m has -44 m, beyond any arm's reach; give metres, not cm or mm"
    ) as caught:
        read_keyframes(path)
    assert caught.value.fields["line"] == third + 1


@pytest.mark.filterwarnings("ignore:.*open from the start:pbd.errors.PbdWarning")
@pytest.mark.parametrize(("old", "word", "state"), [("opens", "closes", "closed"), ("closes", "opens", "open")])
def test_two_grips_in_a_row_that_do_the_same_are_refused(tmp_path: Path, old: str, word: str, state: str) -> None:
    path = edited(tmp_path, f'grip = "{old}"', f'grip = "{word}"')
    first, second = [k for k, keyframe in enumerate(FOUND) if keyframe.grip is not None]
    said = (
        rf'grip "{word}" at keyframe {second} changes nothing, it is {state} since keyframe {first}; remove one of the '
        rf'two, or add grip = "{old}" between them$'
    )
    with pytest.raises(RecordingError, match=said) as caught:
        read_keyframes(path)
    assert line_of(path, caught.value) == f'grip = "{word}"'
    lines = path.read_text(encoding="utf-8").splitlines()
    assert caught.value.fields["line"] == len(lines) - lines[::-1].index(f'grip = "{word}"')  # the second one's


def test_a_keyframe_out_of_reach_is_not_saved(tmp_path: Path) -> None:
    far = replace(FOUND[4], T_nav_sensor=Pose(np.array([0.0, -44.0, 0.0]), FOUND[4].T_nav_sensor.wxyz))
    with pytest.raises(RecordingError, match=r"keyframe 4 .* is 44\.0 m from the dock, .*; nothing is saved"):
        write_keyframes(tmp_path, (*FOUND[:4], far), magnetic=True)
    assert not list(tmp_path.iterdir())


def test_a_person_may_drop_insert_nudge_and_rename(tmp_path: Path) -> None:
    path = write_keyframes(tmp_path, FOUND, magnetic=True)
    head, *tables = path.read_text(encoding="utf-8").split("\n[[keyframe]]")
    own = ' # mine\nt_s = 1.5\ndwell_s = 2.0\nposition_m = [0.1, 0, 0.2]\nrpy_deg = [0, 0, 90]\ngrip = "opens"\n'
    path.write_text("\n[[keyframe]]".join([head, tables[0], own, *tables[2:]]), encoding="utf-8")
    with pytest.warns(PbdWarning, match="it is open from the start"):
        read = read_keyframes(path)
    assert len(read) == len(FOUND)
    assert read[1].dwell_s == 2.0
    assert read[1].grip is False
    assert not read[1].cov.any()
    np.testing.assert_allclose(read[1].T_nav_sensor.p, [0.1, 0.0, 0.2])
    np.testing.assert_allclose(read[1].T_nav_sensor.wxyz, np.sqrt([0.5, 0.0, 0.0, 0.5]), atol=1e-12)
    assert_same(read[2:], FOUND[2:])


@pytest.mark.parametrize(
    ("old", "new", "line", "says"),
    [
        ("dwell_s = ", "dwell_s = -", "dwell_s = -", "must not be below zero"),
        ('grip = "closes"', 'grip = "shut"', 'grip = "shut"', "must be one of closes, opens, got 'shut'"),
        ("position_m = [0.0000, ", "position_m = [0.5, ", "position_m = [0.5, ", "is the dock"),
        ("sigma_m = [", "sigma_mm = [", "sigma_mm = [", "is unknown"),
        ("sigma_m = [0.00", "sigma_m = [-1.00", "sigma_m = [-1.00", "must not be below zero"),
        ("rpy_deg = [", 'frames = ["cup", "cup"]\nrpy_deg = [', "frames = ", "'cup' can't carry itself"),
        (
            "sigma_m = [",
            "tolerance_m = [5, 5, 5]\nsigma_m = [",
            "tolerance_m",
            "must hold only numbers from 1e-09 to 0.5",
        ),
        ("rpy_deg = [", "rpy_deg = [400.0, 0.0, 0.0] # [", "rpy_deg = [400", "must hold only numbers from -360 to 360"),
    ],
)
def test_a_mistake_is_refused_with_its_line(tmp_path: Path, old: str, new: str, line: str, says: str) -> None:
    path = edited(tmp_path, old, new)
    with pytest.raises(RecordingError, match=says) as caught:
        read_keyframes(path)
    assert line_of(path, caught.value).startswith(line)


def test_a_long_dwell_is_warned_of(tmp_path: Path) -> None:
    path = tmp_path / "keyframes.toml"
    for long in range(len(FOUND)):
        stays = [1000.0 if k == long else 0.5 for k in range(len(FOUND))]
        path.write_text(keyframes_toml("tea", FOUND, magnetic=True, arm_dwell_s=stays), encoding="utf-8")
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            read = read_keyframes(path)
        assert [keyframe.dwell_s for keyframe in read] == stays
        lines = path.read_text(encoding="utf-8").splitlines()
        (line,) = (number for number, text in enumerate(lines, start=1) if text.startswith("dwell_s = 1000"))
        said = [str(warning.message) for warning in caught]
        assert [f"{path}:{line}: the arm stays 1000 s at keyframe {long}" in text for text in said] == (
            [True] if 0 < long < len(FOUND) - 1 else []  # the arm doesn't stay at the first and the last
        )


@pytest.mark.parametrize(
    ("later_s", "undone", "told"), [(0.0, False, False), (0.005, False, True), (0.005, True, False)]
)
def test_a_touch_up_without_its_keyframe_is_told(tmp_path: Path, later_s: float, undone: bool, told: bool) -> None:
    touch_up = TouchUp(FOUND[3].t + later_s, np.full(3, 0.001), undone=undone)
    path = write_keyframes(tmp_path, FOUND, magnetic=True, touch_ups=[touch_up])
    with collected_warnings() as said:
        read_keyframes(path)
    line = path.read_text(encoding="utf-8").splitlines().index("[[touch_up]] # of `pbd touch`, which can undo it") + 2
    start = f"{path}:{line}: the touch-up at {touch_up.t:.2f}"
    assert [text.startswith(start) and "is not used" in text for text in said] == [True] * told


def test_the_hands_dwell_is_in_the_comment_of_the_arms() -> None:
    text = keyframes_toml("tea", FOUND, magnetic=True, arm_dwell_s=[0.25] * len(FOUND))
    said = [line for line in text.splitlines() if line.startswith("dwell_s")]
    assert said == [f"dwell_s = 0.250 # the hand stood for {keyframe.dwell_s:.2f} s" for keyframe in FOUND]


@pytest.mark.parametrize("key", ["t_s", "dwell_s", "position_m", "rpy_deg", "sigma_m", "sigma_deg", "grip"])
def test_the_keys_that_the_comment_calls_needed_are_required(tmp_path: Path, key: str) -> None:
    text = keyframes_toml("tea", FOUND, magnetic=True)
    (needed,) = (line for line in text.splitlines() if line.startswith("# Every keyframe needs"))
    path = tmp_path / "keyframes.toml"
    path.write_text("".join(line for line in text.splitlines(True) if not line.startswith(key)), encoding="utf-8")
    if key in needed:
        with pytest.raises(RecordingError, match=f"{key} is missing; add it"):
            read_keyframes(path)
    else:
        assert len(read_keyframes(path)) == len(FOUND)


def test_times_go_forward(tmp_path: Path) -> None:
    path = edited(tmp_path, f"t_s = {FOUND[3].t:.3f}", "t_s = 0.1")
    with pytest.raises(RecordingError, match="must be later than the keyframe before") as caught:
        read_keyframes(path)
    assert line_of(path, caught.value) == "t_s = 0.1"


def test_a_file_without_keyframes_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "keyframes.toml"
    path.write_text("format = 1\n", encoding="utf-8")
    with pytest.raises(RecordingError, match=r"it has no \[\[keyframe\]\]"):
        read_keyframes(path)


def test_an_existing_file_is_only_replaced_by_force(tmp_path: Path) -> None:
    path = write_keyframes(tmp_path, FOUND, magnetic=True)
    path.write_text("mine", encoding="utf-8")
    with pytest.raises(RecordingError, match="may have been edited; --force"):
        write_keyframes(tmp_path, FOUND, magnetic=True)
    assert path.read_text(encoding="utf-8") == "mine"
    for _ in range(2):  # the second time nothing was edited, and nothing more is kept
        with collected_warnings() as told:
            write_keyframes(tmp_path, FOUND, force=True, magnetic=True)
    assert told == []
    assert_same(read_keyframes(path), FOUND)
    assert {file.name for file in tmp_path.iterdir()} == {"keyframes.toml", "keyframes.toml.before"}
    assert (tmp_path / "keyframes.toml.before").read_text(encoding="utf-8") == "mine"


def test_a_demonstration_has_the_keyframes_of_its_file(tmp_path: Path) -> None:
    folder = tmp_path / "tea"
    write_demo(simulate("pour", "modern", 0), folder)
    assert read_demo(folder).keyframes is None
    write_keyframes(folder, FOUND[:4], magnetic=True)
    read = read_demo(folder).keyframes
    assert read is not None
    assert_same(read, FOUND[:4])


def test_an_invalid_edit_is_refused_with_the_files_name(tmp_path: Path) -> None:
    """The error does not name the temporary file, and there is no warning: that comes when the file is read."""
    path = write_keyframes(tmp_path, [FOUND[0], replace(FOUND[1], dwell_s=100.0), *FOUND[2:]], magnetic=True)
    before = path.read_bytes()
    with pytest.raises(RecordingError, match=rf"^{path}:\d+: \[keyframe\] frames ") as caught:
        set_frames(path, {1: ("cup", "lid"), 2: ("lid", "cup")})
    assert caught.value.fields["path"] == path
    assert path.read_bytes() == before


def test_touch_ups_at_the_same_time_are_all_kept(tmp_path: Path) -> None:
    path = write_keyframes(tmp_path, FOUND, magnetic=True)
    with ThreadPoolExecutor() as pool:
        list(pool.map(lambda k: add_touch_up(path, TouchUp(FOUND[k].t, np.full(3, 0.001))), range(1, 6)))
    assert sorted(each.t for each in read_touch_ups(path)) == pytest.approx([each.t for each in FOUND[1:6]], abs=1e-3)


def test_times_outside_the_recording_are_said() -> None:
    """There the hand's way and time are unknown; the ends of the recording, as rounded in the file, are not outside."""
    demo = simulate("pour", "modern", 1)
    path = track(demo)
    keyframes = find_keyframes(path)
    last, end = keyframes[-1], float(path.t[-1])
    for t, outside in ((end + 5e-4, False), (end + 0.5, True)):
        with collected_warnings() as warnings:
            track(replace(demo, keyframes=(*keyframes, replace(last, t=t))))
        assert any(f"keyframe {len(keyframes)} of keyframes.toml: t_s is not" in line for line in warnings) == outside
