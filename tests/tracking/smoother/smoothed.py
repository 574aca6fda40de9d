"""The smoother's estimate of a recording."""

from pbd.data import Recording
from pbd.tracking.estimate import Estimate, estimate
from pbd.tracking.first_rest import find_rest
from pbd.tracking.noise import noise_of
from pbd.tracking.repair.repair_recording import repair_recording


def smoothed(recording: Recording) -> Estimate:
    recording, _ = repair_recording(recording)
    rest = find_rest(recording)
    return estimate(recording, rest, noise_of(recording, rest))
