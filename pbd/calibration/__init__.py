"""The hand's frame into the robot's."""
