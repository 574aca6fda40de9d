"""Drives an arm with Feetech STS3215 servos (so100, so101): the bus, the calibration, the motion and its monitor."""
