"""The fixtures of tests/arm that the audit uses too."""

from tests.arm.conftest import arm, odd_robot, panda

__all__ = ["arm", "odd_robot", "panda"]
