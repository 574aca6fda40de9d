"""A cache of meshes apart from the user's, and browsers if there are any."""

import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import NoReturn

import pytest

from pbd.view.page import write_page
from tests.view import scenes
from tests.view.chromium import Chromium, chromium
from tests.view.firefox import Firefox, firefox


@pytest.fixture(scope="session", autouse=True)
def mesh_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """One cache for all workers of pytest-xdist, so that each mesh is read once."""
    folder = tmp_path_factory.getbasetemp()
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(folder.parent if "PYTEST_XDIST_WORKER" in os.environ else folder))
        yield folder


@pytest.fixture(scope="session", autouse=True)
def light_panda(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Draw the Panda by its collision meshes: a fiftieth of the triangles, as drawing takes most of the time.

    The UR5 keeps its meshes, and test_visuals.py compares those of the bundled robots.
    """
    urdf = tmp_path_factory.mktemp("panda") / "panda.urdf"
    text = scenes.panda().urdf.read_text(encoding="utf-8")
    urdf.write_text(re.sub(r"meshes/visual/(\w+)\.dae", r"meshes/collision/\1.stl", text), encoding="utf-8")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(scenes, "PANDA", urdf)
        yield


@pytest.fixture(scope="package")
def chrome(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chromium]:
    """A headless Chromium; skips without one, unless PBD_REQUIRE_BROWSER=1 says that there must be one."""
    browser = chromium(tmp_path_factory.mktemp("chromium"))
    if browser is None:
        _missing("PBD_REQUIRE_BROWSER", "chromium and chromedriver")
    try:
        yield browser
    finally:
        browser.quit()


@pytest.fixture
def small(chrome: Chromium) -> Iterator[Chromium]:
    """Chromium with small pages: drawing takes most of the time."""
    chrome.set_size(400, 300)
    yield chrome
    chrome.set_size()


@pytest.fixture(scope="package")
def fox(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Firefox]:
    """A Firefox on a screen of its own; skips without one, unless PBD_REQUIRE_FIREFOX=1 says that there must be one."""
    browser = firefox(tmp_path_factory.mktemp("firefox"))
    if browser is None:
        _missing("PBD_REQUIRE_FIREFOX", "firefox (or firefox-esr) and Xvfb")
    try:
        yield browser
    finally:
        browser.quit()


def _missing(variable: str, programs: str) -> NoReturn:
    if os.environ.get(variable) == "1":
        pytest.fail(f"{variable}=1, but {programs} are not both on PATH")
    pytest.skip(f"needs {programs} on PATH")


@pytest.fixture(scope="session")
def replay_file(tmp_path_factory: pytest.TempPathFactory, mesh_cache: Path) -> Path:
    path = tmp_path_factory.mktemp("page") / "replay.html"
    write_page(scenes.pouring(), path)
    return path
