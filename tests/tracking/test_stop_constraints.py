"""Claims about the stops, in the frames of the replay; wrong ones are refused."""

from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import chdtrc, chdtri

from pbd.calibration.tool_poses import KeyframesInBase, tool_poses
from pbd.data import Calibration, Contact, Known, Place
from pbd.data.calibration import DOCK_SIGMA_M, DOCK_SIGMA_RAD
from pbd.data.covariance import PoseCovariance
from pbd.errors import PbdWarning, TrackingError, UsageError
from pbd.pose import Array, Pose, quat_about_z, quat_exp, quat_multiply, quat_rotate
from pbd.tracking.apply_constraints import apply_constraints, measurement_of
from pbd.tracking.keyframes import find_keyframes
from pbd.tracking.stop_constraints import PLACE_SIGMA_M, Claim, claims_of
from tests.near import assert_near
from tests.tracking.hand_paths import covariances, hand_path, mid

# --- the tool and the robot's base ---


@settings(deadline=None, max_examples=25)
@given(st.integers(0, 2**32 - 1))
def test_base_and_tool_are_those_of_the_replay(seed: int) -> None:
    """Claims of what `tool_poses` gives have no misfit: with lever, scale and dock."""
    rng = np.random.default_rng(seed)
    wxyz = quat_exp(rng.normal(size=(4, 3)))
    path = hand_path(np.vstack((np.zeros(3), rng.normal(size=(3, 3)))), covariances(rng, 3, 0.1), wxyz)
    T_base_nav = Pose(rng.normal(size=3), quat_about_z(rng.uniform(-3.0, 3.0)))
    calibration = Calibration(
        "c",
        T_base_nav=T_base_nav,
        T_sensor_tool=Pose(0.1 * rng.normal(size=3), quat_exp(rng.normal(size=3))),
        scale=float(rng.uniform(0.3, 2.0)),
    )
    tools = tool_poses(KeyframesInBase(find_keyframes(path), T_base_nav, calibration))
    x, y, z = tools[2].p.tolist()
    known = Known(
        places=(Place((mid(2),), (x, y, z)),),
        contacts=(Contact(mid(3)), Contact(mid(1), height=float(tools[1].p[2] - tools[0].p[2]))),
    )
    calibration = replace(calibration, table_height=float(tools[3].p[2]))
    fits = apply_constraints(path, known, calibration, T_base_nav).claims
    assert len(fits) == 3
    assert max(fit.off_m for fit in fits) < 1e-12


def test_a_place_is_where_the_scaled_path_has_it_twice() -> None:
    """With a scale of 1.25 the tool turns about its tip if the tracked way is as much shorter than the sensor's."""
    wxyz = quat_exp(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [np.pi / 2, 0.0, 0.0]]))
    tool = Pose(np.array([0.0, 0.0, -0.12]), wxyz[0])
    p_stop = (np.array([0.3, 0.0, 0.0]) - quat_rotate(wxyz, tool.p)) / 1.25
    path = hand_path(p_stop - p_stop[0], np.tile(1e-5 * np.eye(3), (2, 1, 1)), wxyz)
    calibration = Calibration("c", T_sensor_tool=tool, scale=1.25)
    (fit,) = apply_constraints(path, Known(places=(Place((mid(1), mid(2))),)), calibration).claims
    assert fit.off_m == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(
    ("known", "levers", "dock_m"),
    [
        (Known(places=(Place((mid(0), mid(2)), sigma_m=0.001),)), 2, 0.0),
        (Known(contacts=(Contact(mid(2), height=0.0, sigma_m=0.001),)), 2, 0.0),
        (Known(contacts=(Contact(mid(2), sigma_m=0.001),)), 1, DOCK_SIGMA_M),
    ],
    ids=["place", "height", "table"],
)
def test_an_unsure_attitude_makes_what_is_known_of_a_levered_tool_less_sure(
    known: Known, levers: int, dock_m: float
) -> None:
    """A tool 0.1 m ahead of the sensor moves vertically by 0.1 m times the tilt error, at each of the two stops."""
    prior, noise, tool = 2e-3, 0.001**2 + dock_m**2, Pose(np.array([0.1, 0.0, 0.0]), np.array([1.0, 0.0, 0.0, 0.0]))
    calibration = Calibration("c", T_base_nav=Pose.identity(), T_sensor_tool=tool, table_height=0.0)
    for tilt_sigma in (0.0, 0.05):
        path = hand_path(np.zeros((3, 3)), np.tile(0.5 * prior * np.eye(3), (2, 1, 1)))
        cov = path.cov.copy()
        cov[:, 3:, 3:] = tilt_sigma**2 * np.eye(3)
        unsure = replace(path, covariance=PoseCovariance.chained(cov))
        conditioned = apply_constraints(unsure, known, calibration, Pose.identity())
        expected = 1.0 / (1.0 / prior + 1.0 / (noise + levers * (0.1 * tilt_sigma) ** 2))
        assert conditioned.cov[2, 2, 2] == pytest.approx(expected)


def test_far_from_the_dock_a_known_place_is_less_sure_sideways() -> None:
    path = hand_path(np.array([[0.0, 0.0, 0.0], [0.5, 0.0, 0.0]]), np.array([1e-2 * np.eye(3)]))
    calibration = Calibration("c", T_base_nav=Pose.identity())
    cov = apply_constraints(path, Known(places=(Place((mid(1),), (0.5, 0.0, 0.0)),)), calibration, Pose.identity()).cov[
        1
    ]
    along, sideways, up = np.sqrt(np.diagonal(cov)[:3])
    assert along == pytest.approx(up)
    assert along == pytest.approx(np.hypot(PLACE_SIGMA_M, DOCK_SIGMA_M), rel=0.01)
    assert sideways == pytest.approx(np.hypot(along, 0.5 * DOCK_SIGMA_RAD), rel=0.01)


@settings(deadline=None, max_examples=10)
@given(st.integers(0, 2**32 - 1))
def test_errors_of_the_calibration_act_as_finite_differences_say(seed: int) -> None:
    """Where the claims hold, and in nav's lengths: with a scale, a sigma in base is another there."""
    rng, scale = np.random.default_rng(seed), 0.8
    path = hand_path(rng.normal(size=(4, 3)), covariances(rng, 3, 0.1), quat_exp(rng.normal(size=(4, 3))))
    start, mount = (Pose(rng.normal(size=3), quat_exp(rng.normal(size=3))) for _ in range(2))
    p_stop = path.p_nav_sensor[[stop.start for stop in path.stops]]
    wxyz = path.wxyz_nav_sensor[[stop.start for stop in path.stops]]
    x, y, z = start.act(scale * p_stop + quat_rotate(wxyz, mount.p)).T.tolist()
    known = Known(
        places=(Place((mid(1),), (x[1], y[1], z[1]), sigma_m=0.002), Place((mid(0), mid(2)), sigma_m=0.002)),
        contacts=(Contact(mid(3), sigma_m=0.002), Contact(mid(1), height=0.1, sigma_m=0.002)),
    )

    def claims(error: Array) -> tuple[Claim, ...]:
        T_base_nav = Pose(start.p + error[:3], quat_multiply(quat_exp(error[3:6]), start.wxyz))
        tool = Pose(mount.p + error[6:], mount.wxyz)
        calibration = Calibration("c", T_sensor_tool=tool, scale=scale, table_height=z[3])
        return claims_of(path, known, calibration, T_base_nav)

    found = claims(np.zeros(9))
    misfits = [measurement_of(claims(error), p_stop, None)[2] for error in np.vstack((np.eye(9), -np.eye(9))) * 1e-6]
    by_calibration = np.vstack([claim.by_calibration for claim in found])
    assert_near(by_calibration, np.subtract(misfits[:9], misfits[9:]).T / 2e-6, 1e-6)
    sure = Calibration("c", T_base_nav=start, T_sensor_tool=mount)
    unsure = replace(sure, cov_sensor_tool=np.diag((1e-4, 4e-4, 9e-4, 1.0, 1.0, 1.0)))
    more = np.subtract(*(measurement_of(found, p_stop, each)[1] for each in (unsure, sure)))
    assert_near(more, by_calibration[:, 6:] * (1e-4, 4e-4, 9e-4) @ by_calibration[:, 6:].T, 1e-12)
    assert [claim.own_variance + claim.shared_variance for claim in found] == pytest.approx([(0.002 / scale) ** 2] * 4)


def test_a_tool_far_out_over_the_table_is_less_sure_in_height() -> None:
    """The dock's tilt error acts at the tool, not at the sensor."""
    path = hand_path(np.zeros((2, 3)), np.array([1e-2 * np.eye(3)]))
    tool = Pose(np.array([0.3, 0.4, 0.0]), np.array([1.0, 0.0, 0.0, 0.0]))
    calibration = Calibration("c", T_base_nav=Pose.identity(), T_sensor_tool=tool, table_height=0.0)
    (claim,) = claims_of(path, Known(contacts=(Contact(mid(1)),)), calibration, Pose.identity())
    assert claim.by_calibration[0, :6] == pytest.approx([0.0, 0.0, -1.0, -0.4, 0.3, 0.0])


@pytest.mark.parametrize(
    ("known", "message"),
    [
        (
            Known(places=(Place((mid(1),), (0.4, 0.0, 0.1)),)),
            "without a calibration it is unknown where the place at 1.75 s",
        ),
        (Known(contacts=(Contact(mid(1)),)), "the contact at 1.75 s is the only one, and the table's height is not"),
    ],
)
def test_what_needs_a_calibration_is_left_out_and_told(known: Known, message: str) -> None:
    path = hand_path(np.zeros((2, 3)), np.array([1e-4 * np.eye(3)]))
    with pytest.warns(PbdWarning, match=rf"^{message}.*, so it counts only with a robot or a --calibration$"):
        assert apply_constraints(path, known) is path


# --- refused ---

SQUARE = np.array([[0.0, 0.0, 0.0], [0.2, 0.0, 0.0], [0.2, 0.0, 0.31], [0.2, 0.2, 0.0], [0.0, 0.3, 0.0]])


@pytest.mark.parametrize(
    ("known", "message"),
    [
        (
            Known(closed=True),
            "demo.toml says that the hand returned to its start, but it ended 30 cm away (sigma 2.0 cm, 15 sigma); "
            "remove the line `closed = true` at the file's top, not one of a [[grip]], or record again",
        ),
        (
            Known(places=(Place((mid(1), mid(3))),)),
            "demo.toml says that the tool at 4.75 s (stop 3) is where it was at 1.75 s (stop 1), but it is 20 cm off "
            "(sigma 1.4 cm, 14 sigma); remove that [[place]], or record again",
        ),
        (
            Known(places=(Place((mid(3),), (0.45, 0.2, 0.0)),)),
            "demo.toml says that the tool at 4.75 s (stop 3) is at 0.450, 0.200, 0.000 m in base, but it is 25 cm off "
            "(sigma 1.8 cm, 14 sigma); remove that [[place]], or correct the dock (--calibration; each robot's own is "
            "elsewhere), or record again",
        ),
        (
            Known(contacts=(Contact(mid(2)), Contact(mid(3)))),
            "demo.toml says that the tool at 3.25 s (stop 2) is on the table, but it is 31 cm off "
            "(sigma 1.5 cm, 21 sigma); remove that [[contact]], say as_at_s there, correct the calibration's "
            "table_height, or record again",
        ),
        (
            Known(contacts=(Contact(mid(3), as_at=mid(2)),)),
            "demo.toml says that the tool at 4.75 s (stop 3) is as high as at 3.25 s (stop 2), but it is 31 cm off "
            "(sigma 1.0 cm, 30 sigma); remove that [[contact]], or record again",
        ),
        (
            Known(contacts=(Contact(mid(3), height=0.09),)),
            "demo.toml says that the tool at 4.75 s (stop 3) is 0.090 m above its first rest, but it is 9.0 cm off "
            "(sigma 1.8 cm, 5.1 sigma); remove that [[contact]], or record again",
        ),
    ],
    ids=["closed", "place", "position", "table", "as_at", "height"],
)
def test_a_contradiction_is_refused_with_its_figures(known: Known, message: str) -> None:
    path = hand_path(SQUARE, np.tile(0.01**2 * np.eye(3), (4, 1, 1)))
    calibration = Calibration("c", T_base_nav=Pose.identity(), table_height=0.0)
    with pytest.raises(TrackingError) as caught:
        apply_constraints(path, known, calibration, Pose.identity())
    assert caught.value.message == message


def test_two_contacts_without_a_tables_height_are_compared() -> None:
    path = hand_path(SQUARE, np.tile(0.01**2 * np.eye(3), (4, 1, 1)))
    with pytest.raises(TrackingError, match=r"stop 3\) is on the table as at 3\.25 s \(stop 2\), but it is 31 cm off"):
        apply_constraints(path, Known(contacts=(Contact(mid(2)), Contact(mid(3)))))


@pytest.mark.parametrize(("sigmas", "refused"), [(2.95, False), (3.05, True)])
def test_three_sigma_of_a_height_is_the_bound(sigmas: float, refused: bool) -> None:
    off = sigmas * np.hypot(0.01, PLACE_SIGMA_M)
    path = hand_path(np.array([[0.0, 0.0, 0.0], [0.1, 0.0, off]]), np.array([0.01**2 * np.eye(3)]))
    known = Known(contacts=(Contact(mid(1), height=0.0),))
    if refused:
        with pytest.raises(TrackingError, match=r"3\.\d sigma"):
            apply_constraints(path, known)
    else:
        (fit,) = apply_constraints(path, known).claims
        assert fit.sigmas == pytest.approx(sigmas)


@pytest.mark.parametrize(
    ("dimension", "known"), [(3, Known(closed=True)), (1, Known(contacts=(Contact(mid(1), height=0.0),)))]
)
def test_the_bound_is_as_improbable_in_space_as_in_height(dimension: int, known: Known) -> None:
    """0.27 % of true claims are refused; of errors twice as large, as many as the chi-square distribution predicts."""
    rng = np.random.default_rng(0)
    moves = covariances(rng, 1, 0.01)
    root = 2.0 * np.linalg.cholesky(moves[0] + PLACE_SIGMA_M**2 * np.eye(3))
    refused, n = 0, 300
    for _ in range(n):
        path = hand_path(np.array([np.zeros(3), root @ rng.normal(size=3)]), moves)
        try:
            apply_constraints(path, known)
        except TrackingError:
            refused += 1
    share = chdtrc(dimension, chdtri(dimension, 0.0027) / 4.0)
    assert abs(refused - n * share) < 4.0 * np.sqrt(n * share * (1.0 - share))


def test_the_claim_most_at_fault_is_the_one_that_is_named() -> None:
    """Four places agree that the drift is small. The other alone would be accepted; against them it is refused."""
    p_stop = np.zeros((6, 3))
    p_stop[:, 0] = [0.0, 0.0, 0.0, 0.05, 0.0, 0.0]
    path = hand_path(p_stop, np.tile(0.01**2 * np.eye(3), (5, 1, 1)))
    pairs = tuple(Place((mid(0), mid(k)), sigma_m=0.0005) for k in range(1, 6))
    apply_constraints(path, Known(places=(pairs[2],)))
    with pytest.raises(TrackingError, match=r"the tool at 4\.75 s \(stop 3\) is .* against the other claims") as caught:
        apply_constraints(path, Known(places=pairs))
    assert caught.value.fields["stop"] == 3
    assert caught.value.fields["t"] == pytest.approx(mid(3), abs=0.03)  # the middle is between two rows


@pytest.mark.parametrize("off", [1, 2, 3])
@pytest.mark.parametrize(
    ("known", "saying", "remedy"),
    [
        (Known(places=(Place((mid(1), mid(2), mid(3))),)), "where it was", "that time from its [[place]]"),
        (Known(contacts=tuple(Contact(mid(k)) for k in (1, 2, 3))), "on the table as", "that [[contact]]"),
    ],
    ids=["place", "table"],
)
def test_the_visit_that_is_off_is_named_also_if_it_comes_first(
    off: int, known: Known, saying: str, remedy: str
) -> None:
    """All claims of a group refer to its first visit: if that one is off, each of them is."""
    p_stop = np.zeros((4, 3))
    p_stop[off, 2] = 0.1
    path = hand_path(p_stop, np.tile(0.005**2 * np.eye(3), (3, 1, 1)))
    with pytest.raises(TrackingError) as caught:
        apply_constraints(path, known)
    assert f"(stop {off}) is {saying} at {mid(2 if off == 1 else 1):.2f} s" in caught.value.message
    assert f"; remove {remedy}, or record again" in caught.value.message
    assert caught.value.fields["stop"] == off


@pytest.mark.parametrize(
    ("known", "message"),
    [
        (
            Known(places=(Place((mid(1), 99.0)),)),
            r"a \[\[place\]\] names 99.00 s, but the hand does not stop there: the nearest stop, 4, is from 6.00 to "
            "6.45 s; give a time within a stop",
        ),
        (
            Known(places=(Place((mid(1), mid(1) + 0.1)),)),
            r"a \[\[place\]\] names 1.75 and 1.85 s, but both are in one stop, 1, from 1.50 to 1.95 s; give times "
            "within different stops",
        ),
        (Known(contacts=(Contact(mid(1)), Contact(mid(1) + 0.1))), r"\[\[contact\]\] with the table names 1.75 and"),
        (Known(contacts=(Contact(1.6, as_at=1.7),)), r"a \[\[contact\]\] with its as_at_s names 1.60 and 1.70 s"),
    ],
)
def test_a_time_without_a_stop_of_its_own(known: Known, message: str) -> None:
    path = hand_path(SQUARE, np.tile(np.eye(3), (4, 1, 1)))
    with pytest.raises(TrackingError, match=f"^{message}"):
        apply_constraints(path, known)


def test_a_time_near_a_stop_names_it() -> None:
    path = hand_path(0.01 * SQUARE, np.tile(1e-3 * np.eye(3), (4, 1, 1)))
    (fit,) = apply_constraints(path, Known(places=(Place((mid(1), mid(3) + 0.6)),))).claims
    assert fit.stop == 3


def test_a_path_is_conditioned_once() -> None:
    path = apply_constraints(hand_path(np.zeros((2, 3)), np.array([1e-4 * np.eye(3)])), Known(closed=True))
    with pytest.raises(ValueError, match="already"):
        apply_constraints(path, Known(closed=True))


def test_what_makes_no_sense_is_no_value() -> None:
    for times in ((), (1.0,), (1.0, 1.0)):
        with pytest.raises(UsageError, match="Place must name"):
            Place(times)
    for sigma in (0.0, -1.0, float("nan")):
        with pytest.raises(UsageError, match=r"Place\.sigma_m must be above 0"):
            Place((1.0, 2.0), sigma_m=sigma)
        with pytest.raises(UsageError, match=r"Contact\.sigma_m must be above 0"):
            Contact(1.0, sigma_m=sigma)
    with pytest.raises(UsageError, match="as_at or height, not both"):
        Contact(1.0, as_at=2.0, height=0.0)
    with pytest.raises(UsageError, match="two stops"):
        Contact(1.0, as_at=1.0)


def test_a_claim_whose_values_are_no_numbers_is_refused() -> None:
    """An instant that is NaN was taken for stop 0."""
    nan = float("nan")
    for times in (3.0, (nan, 12.2), "34", ("a", "b")):
        with pytest.raises(UsageError, match=r"^Place\.t must be "):
            Place(cast(tuple[float, ...], times))
    for place in ((0.4, nan, 0.1), (0.4, 0.1), 0.4):
        with pytest.raises(UsageError, match=r"^Place\.p_base_tool must be "):
            Place((3.0,), cast(tuple[float, float, float], place))
    for values in ({"t": nan}, {"t": 1.0, "as_at": nan}, {"t": 1.0, "height": nan}):
        with pytest.raises(UsageError, match=rf"^Contact\.{list(values)[-1]} must be "):
            Contact(**cast(dict[str, Any], values))
