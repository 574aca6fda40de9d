"""What the browser tests ask of an open page."""

from __future__ import annotations

import io
import json
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from selenium.webdriver import Chrome

from pbd.pose import Array

PATIENCE_S = 30.0


def until(condition: Callable[[], object], what: str, seconds: float = PATIENCE_S) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, f"waited {seconds} s for {what}"
        time.sleep(0.05)


class Page:
    """An open page: a replay's, or that of a recording under way."""

    def __init__(self, chrome: Chrome, address: str) -> None:
        self.chrome = chrome
        chrome.get_log("browser")
        chrome.get_log("performance")
        chrome.get(address)
        until(lambda: self("return window.pbd && pbd.ready"), f"{address} to start; the browser says {self.errors()}")

    def __call__(self, script: str) -> Any:
        return self.chrome.execute_script(script)

    def errors(self) -> list[str]:
        """What the browser complains of; that software rendering is slow is not the page's fault."""
        messages = [str(entry["message"]) for entry in self.chrome.get_log("browser")]
        return [message for message in messages if "GPU stall due to ReadPixels" not in message]

    def requests(self) -> set[str]:
        """Addresses that were asked for since the page was opened, the browser's own (chrome:) left out."""
        events = [json.loads(entry["message"])["message"] for entry in self.chrome.get_log("performance")]
        asked = [event["params"] for event in events if event["method"] == "Network.requestWillBeSent"]
        sockets = [event["params"] for event in events if event["method"] == "Network.webSocketCreated"]
        addresses = {str(each["request"]["url"]) for each in asked} | {str(each["url"]) for each in sockets}
        return {address for address in addresses if not address.startswith(("chrome", "data:", "about:"))}

    def read(self, selector: str) -> str:
        """The text of the first element of its kind."""
        return str(self(f"return document.querySelector({json.dumps(selector)}).textContent"))

    def place(self, *path: str) -> Array:
        """Position (3,) m in base of a node of the scene."""
        node = "".join(f".children[{json.dumps(name)}]" for name in path)
        script = f"""
            const stage = pbd.page.stage, node = stage.viewer.scene_tree{node}.object;
            stage.viewer.scene.updateMatrixWorld(true);
            return stage.viewer.scene.worldToLocal(node.getWorldPosition(new MeshCat.THREE.Vector3())).toArray();"""
        return np.array(self(script))

    def picture(self) -> NDArray[np.uint8]:
        """A screenshot (height, width, 3) with the scene drawn finely."""
        self("pbd.page.stage.render()")
        until(lambda: self("return pbd.page.stage.quality.fine"), "the fine picture")
        return np.asarray(Image.open(io.BytesIO(self.chrome.get_screenshot_as_png())).convert("RGB"))


class Replay(Page):
    """A replay, paused at its start."""

    def __init__(self, chrome: Chrome, address: str) -> None:
        super().__init__(chrome, address)
        self("pbd.page.player.pause(); pbd.page.player.seek(0)")

    @property
    def time(self) -> float:
        return float(self("return pbd.page.player.time"))
