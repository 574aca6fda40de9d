"""The number of BLAS threads."""

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from pbd import pipeline, track_recording
from pbd.data import Recording
from pbd.lapack import lapack, one_blas_thread


def blas_threads() -> set[int]:
    return {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"}


def test_the_last_caller_to_leave_gives_the_threads_back() -> None:
    lapack()
    with threadpool_limits(3):
        with one_blas_thread:
            with one_blas_thread:
                assert blas_threads() == {1}
            assert blas_threads() == {1}
        assert blas_threads() == {3}


def test_tracking_takes_one_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    def seen(_: Recording) -> None:
        raise RuntimeError(f"threads: {blas_threads()}")

    monkeypatch.setattr(track_recording, "repair_recording", seen)
    still = Recording(np.arange(9.0), np.ones((9, 3)), None)
    with threadpool_limits(3):
        with pytest.raises(RuntimeError, match=r"threads: \{1\}"):
            pipeline.track(still)
        assert blas_threads() == {3}
