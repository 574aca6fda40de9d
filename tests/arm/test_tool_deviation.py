"""The tool's deviation on a straight move in joint space."""

import numpy as np
import pytest

from pbd.arm.tool_deviation import tool_deviations
from tests.arm.bundled import arm_of

UR5 = arm_of("ur5")
HOME = UR5.robot.home


@pytest.mark.parametrize(
    ("angle", "direct"), [(0.0, 0.0), (1e-6, 1e-6), (0.5 * np.pi, 0.5 * np.pi), (1.5 * np.pi, 0.5 * np.pi)]
)
def test_the_last_joint_turns_the_tool_by_itself(angle: float, direct: float) -> None:
    (deviation,) = tool_deviations(UR5, HOME[None], HOME + angle * np.eye(6)[[5]])
    assert (deviation.turn_rad, deviation.direct_rad) == pytest.approx((angle, direct), rel=1e-6)
    assert deviation.wide == deviation.turns == (angle > np.pi)


def test_the_first_joint_takes_the_tool_along_an_arc() -> None:
    """Large angles bring it farther from the chord than a wide move's bound, small ones do not."""
    radius = float(np.linalg.norm(UR5.forward(HOME).p[:2]))
    for angle in (0.3, 2.0, 2.3, 3.0):
        (deviation,) = tool_deviations(UR5, HOME[None], HOME + angle * np.eye(6)[[0]])
        sagitta, chord = radius * (1.0 - np.cos(0.5 * angle)), 2.0 * radius * np.sin(0.5 * angle)
        assert (deviation.off_line_m, deviation.line_m) == pytest.approx((sagitta, chord), rel=1e-2)
        assert deviation.wide == (sagitta > 0.1 + 0.25 * chord)
        assert not deviation.turns
    assert deviation.wide
    assert str(deviation) == f"stray {100.0 * sagitta:.0f} cm from a line of {100.0 * chord:.0f} cm"
