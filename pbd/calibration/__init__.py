"""Calibration: nav in the robot's base, the sensor's errors, the sensor on the tool."""
