"""The audit checks a finished trajectory independently of the planner: no motion is shown or written unaudited.

Nothing here imports pbd.arm. The audit and the planner share what files say (the URDF's model and shapes, the values of
the robot and of the calibration). The audit computes everything else anew: extrema, poses, the pairs to check and their
distances.
"""
