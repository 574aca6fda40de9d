"""Simulates a hand with a sensor: motion, sensor errors, the true path, and a sensor on a pseudo-terminal."""
