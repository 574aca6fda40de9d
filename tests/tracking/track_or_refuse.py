"""Track a recording, or have it refused."""

import numpy as np
import pytest

from pbd.data import HandPath, Recording
from pbd.errors import PbdError
from pbd.pipeline import track
from pbd.track_recording import METHODS

every_method = pytest.mark.parametrize("method", METHODS)
quietly = pytest.mark.filterwarnings("ignore::pbd.errors.PbdWarning")


def path_or_none(recording: Recording, method: str) -> HandPath | None:
    """The path, which must be sound, or None if the recording is refused. Any other exception is a bug."""
    try:
        path = track(recording, method)
    except PbdError:
        return None
    for values in (path.t, path.p_nav_sensor, path.v_nav_sensor, path.wxyz_nav_sensor, path.closure, path.cov):
        assert np.isfinite(values).all()
    assert len(path.p_nav_sensor) == len(recording)
    assert np.linalg.norm(path.wxyz_nav_sensor, axis=1) == pytest.approx(1.0)
    assert np.linalg.eigvalsh(path.cov).min() >= -1e-9 * np.abs(path.cov).max()
    return path
