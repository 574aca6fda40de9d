"""Inverse kinematics: one pose, all its branches, part of a pose, a line of poses."""
