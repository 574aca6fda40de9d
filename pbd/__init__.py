"""Programming by demonstration for robot arms, from an inertial sensor in the hand.

    path = pbd.track(pbd.load_demo("pouring").recording)
    trajectory = pbd.plan(path, calibration, robot)

Nothing heavy is imported before it is used.
"""

from __future__ import annotations

__version__ = "0.1.0"
