"""Access to a page that is open in a browser, for tests."""

import base64
import io
import json
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from pbd.pose import Array
from tests.view.chromium import Chromium
from tests.view.firefox import Firefox

PATIENCE_S = 60.0

Browser = Chromium | Firefox

COARSE = """
    const { quality } = pbd.page.stage;
    Object.assign(quality.constructor, { settle_ms: 1e8, coarse_pixels: 2e4 });
    clearTimeout(quality.settleTimer);"""
"""Scenes are drawn coarsely, as drawing takes most of the time without a graphics card."""

LOADED_AT = (60, 40)
"""Size of a page, pixels, while it starts: its first frames are drawn before COARSE."""


def until(condition: Callable[[], object], what: str, seconds: float = PATIENCE_S) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, f"waited {seconds} s for {what}"
        time.sleep(0.05)


class Page:
    """An open page: of a replay or of a running recording."""

    def __init__(self, browser: Browser, address: str) -> None:
        self.browser: Any = browser  # Chromium has more methods, without types
        browser.errors()
        browser.requests()
        size = browser.size
        browser.set_size(*LOADED_AT)
        browser.get(address)
        until(lambda: self("return window.pbd && pbd.ready"), f"{address} to start; the browser says {self.errors()}")
        self(COARSE)
        browser.set_size(*size)
        until(lambda: self("return [innerWidth, innerHeight]") == list(size), f"a page of {size}")

    def __call__(self, script: str) -> Any:
        return self.browser.execute_script(script)

    def errors(self) -> list[str]:
        """The browser's error messages since the last call, or since the page was opened."""
        return list(self.browser.errors())

    def requests(self) -> set[str]:
        """Addresses that the page requested since the last call, or since it was opened."""
        return set(self.browser.requests())

    def read(self, selector: str) -> str:
        """The text of the first element that matches."""
        return str(self(f"return document.querySelector({json.dumps(selector)}).textContent"))

    def place(self, *path: str) -> Array:
        """Position (3,) m in base of a node of the scene."""
        node = "".join(f".children[{json.dumps(name)}]" for name in path)
        script = f"""
            const stage = pbd.page.stage, node = stage.viewer.scene_tree{node}.object;
            stage.viewer.scene.updateMatrixWorld(true);
            return stage.viewer.scene.worldToLocal(node.getWorldPosition(new MeshCat.THREE.Vector3())).toArray();"""
        return np.array(self(script))

    def projected(self, p_base: Array) -> NDArray[np.int64]:
        """The pixels (n, 2), x and y, in which points (n, 3) m in base lie."""
        script = f"""
            const {{ viewer, camera }} = pbd.page.stage, {{ scene }} = viewer;
            scene.updateMatrixWorld(true);
            camera.updateMatrixWorld();
            const place = (p) => scene.localToWorld(new MeshCat.THREE.Vector3(...p)).project(camera);
            return {json.dumps(p_base.tolist())}.map(place).map(({{ x, y }}) => [x, y]);"""
        width, height = self("return [innerWidth, innerHeight]")
        seen = 0.5 + 0.5 * np.array(self(script)) * (1.0, -1.0)
        pixels: NDArray[np.int64] = np.floor(seen * (width, height)).astype(np.int64)
        return pixels

    def drawn(self, *nodes: str, link: str | None = None) -> NDArray[np.int64]:
        """The scene (height, width, RGBA) with only these nodes, drawn finely, without shadows and labels.

        With a link, no other link of the robot is drawn.
        """
        script = f"""
            const {{ viewer, camera, quality }} = pbd.page.stage;
            const {{ children }} = viewer.scene_tree.children.pbd;
            const below = (tree) => Object.entries(tree.children).flatMap(([name, child]) =>
                [[name, child.object], ...below(child)]);
            const links = below(children.robot).filter(([name]) => /^[0-9]+:/.test(name));
            const link = {json.dumps(link)};
            for (const name in children) children[name].object.visible = {json.dumps(nodes)}.includes(name);
            for (const [name, object] of links) object.visible = link === null || name.split(":")[1] === link;
            const {{ caster }} = quality;
            caster.castShadow = false;
            quality.caster = null;
            quality.drawSmooth(viewer.scene, camera);
            quality.caster = caster;
            const picture = quality.renderer.domElement.toDataURL();
            for (const name in children) children[name].object.visible = true;
            for (const [, object] of links) object.visible = true;
            return picture.split(",")[1];"""
        return np.asarray(Image.open(io.BytesIO(base64.b64decode(self(script)))).convert("RGBA")).astype(np.int64)

    def picture(self) -> NDArray[np.uint8]:
        """A screenshot (height, width, 3) with the scene drawn finely."""
        self("pbd.page.stage.quality.constructor.settle_ms = 0; pbd.page.stage.render()")
        until(lambda: self("return pbd.page.stage.quality.fine"), "the fine picture")
        self(COARSE)
        return np.asarray(Image.open(io.BytesIO(self.browser.get_screenshot_as_png())).convert("RGB"))


class Replay(Page):
    """A replay, paused at its start."""

    def __init__(self, browser: Browser, address: str) -> None:
        super().__init__(browser, address)
        self.began = bool(self("return pbd.page.player.playing"))
        self("pbd.page.player.pause(); pbd.page.player.seek(0)")

    @property
    def time(self) -> float:
        return float(self("return pbd.page.player.time"))
