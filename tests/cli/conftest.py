"""Fixtures of the tests of commands."""

import pytest


@pytest.fixture(autouse=True)
def quick(cached_results: None, unadvised: None) -> None:
    """Track and plan each input once, without a plan for advice."""
