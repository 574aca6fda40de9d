"""A Firefox that needs no graphics card. It runs on a virtual screen (Xvfb), as headless Firefox has no WebGL.

Debian has no geckodriver, which Selenium needs. So tests use Firefox' own protocol, Marionette: a message is a length,
a colon and JSON; the answer to [0, number, command, parameters] is [1, number, error, result].
"""

import base64
import json
import os
import shutil
import socket
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

PREFERENCES = {
    "marionette.port": 0,
    "app.normandy.enabled": False,
    "app.update.disabledForTesting": True,
    "browser.shell.checkDefaultBrowser": False,
    "datareporting.policy.dataSubmissionEnabled": False,
    "network.captive-portal-service.enabled": False,
    "network.connectivity-service.enabled": False,
    "services.settings.server": "data:,#",
    "browser.safebrowsing.update.enabled": False,
    "ui.prefersReducedMotion": 1,
    # What no test needs takes half of the start: the first page, spare processes, bundled add-ons.
    "browser.startup.page": 0,
    "browser.newtabpage.enabled": False,
    "browser.aboutwelcome.enabled": False,
    "dom.ipc.processPrelaunch.enabled": False,
    "extensions.enabledScopes": 0,
}
PATIENCE_S = 60.0

LISTEN = """
    window.asked = [];
    Services.obs.addObserver({ observe: (channel) => {
      channel.QueryInterface(Ci.nsIChannel);
      if (channel.loadInfo.browsingContextID) window.asked.push(channel.URI.spec);
    } }, "http-on-opening-request");
"""
ASKED = "return window.asked.splice(0)"
MESSAGES = """
    const storage = Cc["@mozilla.org/consoleAPI-storage;1"].getService(Ci.nsIConsoleAPIStorage);
    const said = storage.getEvents().filter((each) =>
      /^(error|warn)$/.test(each.level) && !each.filename.startsWith("resource:"));
    const wrong = Services.console.getMessageArray().filter((each) => each instanceof Ci.nsIScriptError
      && !(each.flags & Ci.nsIScriptError.warningFlag) && /^(file|http)/.test(each.sourceName));
    storage.clearEvents();
    Services.console.reset();
    return [...said.map((each) => each.arguments.join(" ")), ...wrong.map(String)];
"""


class Firefox:
    """A Firefox with its profile in a folder; its pages have 1200 x 750 pixels."""

    def __init__(self, binary: str, xvfb: str, profile: Path) -> None:
        profile.mkdir(exist_ok=True)
        lines = (f'user_pref("{name}", {json.dumps(value)});' for name, value in PREFERENCES.items())
        (profile / "user.js").write_text("\n".join(lines))
        with ExitStack() as stack:
            screen = [xvfb, "-displayfd", "1", "-screen", "0", "1300x950x24", "-nolisten", "tcp"]
            display = self._start(stack, screen, stdout=subprocess.PIPE).stdout
            assert display is not None
            env = {**os.environ, "DISPLAY": f":{stack.enter_context(display).readline().decode().strip()}"}
            options = ["--marionette", "--remote-allow-system-access", "--no-remote", "--profile", str(profile)]
            self._start(stack, [binary, *options], env=env, stdout=subprocess.DEVNULL)
            told = profile / "MarionetteActivePort"
            _until(lambda: told.exists() and told.read_text(), "Firefox to start")
            address = "127.0.0.1", int(told.read_text())
            self._socket = stack.enter_context(socket.create_connection(address, PATIENCE_S))
            self._stream = stack.enter_context(self._socket.makefile("rb"))
            self._receive()  # the greeting
            self._ask("WebDriver:NewSession")
            self._ask("WebDriver:SetWindowRect", x=0, y=0, width=1250, height=900)
            self._chrome(LISTEN)
            self.set_size()
            self._running = stack.pop_all()

    @staticmethod
    def _start(stack: ExitStack, command: list[str], **options: Any) -> subprocess.Popen[bytes]:
        process = subprocess.Popen(command, stderr=subprocess.DEVNULL, **options)
        stack.callback(process.wait)
        stack.callback(process.kill)
        return process

    def quit(self) -> None:
        """End it and its screen."""
        self._running.close()

    def get(self, address: str) -> None:
        """Open a page."""
        self._ask("WebDriver:Navigate", url=address)

    def execute_script(self, script: str) -> Any:
        """Run a function's body in the page."""
        return self._ask("WebDriver:ExecuteScript", script=script, args=[])

    def get_screenshot_as_png(self) -> bytes:
        """A screenshot of the page."""
        return base64.b64decode(self._ask("WebDriver:TakeScreenshot", full=False))

    def press(self, key: str) -> None:
        """Press and release a key, given in WebDriver's code."""
        acts = [{"type": kind, "value": key} for kind in ("keyDown", "keyUp")]
        self._ask("WebDriver:PerformActions", actions=[{"type": "key", "id": "keys", "actions": acts}])

    def set_size(self, width: int = 1200, height: int = 750) -> None:
        """Set the size of pages, pixels."""
        self.size = width, height
        style = f"min-width: {width}px; max-width: {width}px; min-height: {height}px; max-height: {height}px"
        self._chrome(f"gBrowser.selectedBrowser.style = '{style}'")
        size = [width, height]
        _until(lambda: self.execute_script("return [innerWidth, innerHeight]") == size, f"a page of {width} x {height}")

    @contextmanager
    def preference(self, name: str, value: bool) -> Iterator[None]:
        """Change a preference within the context."""
        self._chrome(f"Services.prefs.setBoolPref('{name}', {json.dumps(value)})")
        try:
            yield
        finally:
            self._chrome(f"Services.prefs.clearUserPref('{name}')")

    def errors(self) -> list[str]:
        """Error messages of the page, and requests that were forbidden to it, since the last call."""
        return [str(each) for each in self._ask("WebDriver:ExecuteScript", script=MESSAGES, args=[], sandbox="system")]

    def requests(self) -> set[str]:
        """Addresses that pages requested from servers since the last call, without files."""
        return {str(address) for address in self._chrome(ASKED)}

    def _chrome(self, script: str) -> Any:
        """Run a script with the browser's own privileges."""
        self._ask("Marionette:SetContext", value="chrome")
        try:
            return self.execute_script(script)
        finally:
            self._ask("Marionette:SetContext", value="content")

    def _ask(self, command: str, **params: Any) -> Any:
        packed = json.dumps([0, 0, command, params]).encode()
        self._socket.sendall(b"%d:%s" % (len(packed), packed))
        _, _, error, result = self._receive()
        if error is not None:
            raise RuntimeError(f"{command}: {error['message']}")
        return result.get("value") if isinstance(result, dict) else result

    def _receive(self) -> Any:
        length = b""
        while not length.endswith(b":"):
            if not (byte := self._stream.read(1)):
                raise ConnectionError("Firefox has closed the connection")
            length += byte
        return json.loads(self._stream.read(int(length[:-1])))


def _until(condition: Callable[[], object], what: str) -> None:
    end = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end, f"waited {PATIENCE_S} s for {what}"
        time.sleep(0.05)


def firefox(profile: Path) -> Firefox | None:
    """Start one; None if it or Xvfb is not on PATH."""
    binary = shutil.which("firefox-esr") or shutil.which("firefox")
    xvfb = shutil.which("Xvfb")
    return Firefox(binary, xvfb, profile) if binary and xvfb else None
