"""Calibration: nav in the robot's base, the sensor's errors, and the mount of the sensor on the tool."""
