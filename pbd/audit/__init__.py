"""Whether a trajectory keeps its promises: nothing is shown or written unaudited.

Nothing here imports pbd.arm. The audit shares with the planner what files say (the URDF's model and shapes, the robot's
and the calibration's values) and works out the rest anew: extrema, poses, which pairs to check, and how far they are.
"""
