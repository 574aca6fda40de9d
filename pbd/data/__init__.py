"""The frozen values that pass between the stages.

Arrays are copied in, made read-only, and checked for their shape, so every value is well formed.
All units are SI and radians. Names contain frames: `sensor`, `nav`, `base`, `tool`, `dock`.
"""

from pbd.data.calibration import TOOL_DOWN, Calibration, LinearErrors, SensorErrors
from pbd.data.constraints import ClaimFit, Contact, Known, Place
from pbd.data.estimated_sensor_errors import ErrorEstimate, SensorEstimate
from pbd.data.fusion import FusedTake, Fusion, MovedThing
from pbd.data.joint_trajectory import JointTrajectory, Samples
from pbd.data.keyframe import Keyframe, TouchUp
from pbd.data.recording import GripEvent, Recording, RecordingInfo, Truth
from pbd.data.robot import Gripper, JointLimits, MimicJoint, Robot, ServoUnits
from pbd.data.tracking import Demonstration, HandPath, HandSegment, Stop, Tracking
from pbd.data.units import GRAVITY
from pbd.data.world import GraspedObject, Load, Obstacle

__all__ = [
    "GRAVITY",
    "TOOL_DOWN",
    "Calibration",
    "ClaimFit",
    "Contact",
    "Demonstration",
    "ErrorEstimate",
    "FusedTake",
    "Fusion",
    "GraspedObject",
    "GripEvent",
    "Gripper",
    "HandPath",
    "HandSegment",
    "JointLimits",
    "JointTrajectory",
    "Keyframe",
    "Known",
    "LinearErrors",
    "Load",
    "MimicJoint",
    "MovedThing",
    "Obstacle",
    "Place",
    "Recording",
    "RecordingInfo",
    "Robot",
    "Samples",
    "SensorErrors",
    "SensorEstimate",
    "ServoUnits",
    "Stop",
    "TouchUp",
    "Tracking",
    "Truth",
]
