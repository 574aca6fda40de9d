"""A cache of meshes that is not the user's, and a browser where there is one."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from selenium.webdriver import Chrome

from pbd.view.page import write_page
from tests.view import scenes
from tests.view.chromium import chromium


@pytest.fixture(scope="session", autouse=True)
def mesh_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    with pytest.MonkeyPatch.context() as patch:
        folder = tmp_path_factory.mktemp("cache")
        patch.setenv("XDG_CACHE_HOME", str(folder))
        yield folder


@pytest.fixture(scope="session")
def chrome(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chrome]:
    """A headless Chromium; skips without one, unless PBD_REQUIRE_BROWSER=1 says that there must be one."""
    browser = chromium(tmp_path_factory.mktemp("chromium"))
    if browser is None:
        if os.environ.get("PBD_REQUIRE_BROWSER") == "1":
            pytest.fail("PBD_REQUIRE_BROWSER=1, but chromium and chromedriver are not both on PATH")
        pytest.skip("needs chromium and chromedriver on PATH")
    try:
        yield browser
    finally:
        browser.quit()


@pytest.fixture(scope="session")
def replay_file(tmp_path_factory: pytest.TempPathFactory, mesh_cache: Path) -> Path:
    path = tmp_path_factory.mktemp("page") / "replay.html"
    write_page(scenes.pouring(), path)
    return path
