"""Driving an arm of Feetech STS3215 servos (so100, so101): its bus, its calibration, the motion and the watch on it."""
