"""The arms of tests/arm."""

from tests.arm.conftest import arm, odd_robot, panda

__all__ = ["arm", "odd_robot", "panda"]
