"""A Firefox that draws without a graphics card, on a screen of its own (Xvfb): headless it has no WebGL."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from selenium.webdriver import FirefoxOptions
from selenium.webdriver.remote.webdriver import WebDriver

from tests.view.marionette import Marionette

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
}
SCHEMES = {"dark": 0, "light": 1}
PATIENCE_S = 60.0

LISTEN = """
    window.asked = [];
    Services.obs.addObserver({ observe: (channel) => {
      channel.QueryInterface(Ci.nsIChannel);
      if (channel.loadInfo.browsingContextID) window.asked.push(channel.URI.spec);
    } }, "http-on-opening-request");
"""
ASKED = "return window.asked.splice(0)"
COMPLAINTS = """
    const storage = Cc["@mozilla.org/consoleAPI-storage;1"].getService(Ci.nsIConsoleAPIStorage);
    const said = storage.getEvents().filter((each) =>
      /^(error|warn)$/.test(each.level) && !each.filename.startsWith("resource:"));
    const wrong = Services.console.getMessageArray().filter((each) => each instanceof Ci.nsIScriptError
      && !(each.flags & Ci.nsIScriptError.warningFlag) && /^(file|http)/.test(each.sourceName));
    storage.clearEvents();
    Services.console.reset();
    return [...said.map((each) => each.arguments.join(" ")), ...wrong.map(String)];
"""


class Firefox(WebDriver):  # type: ignore[misc]  # selenium is not followed
    """Started with a profile that is kept in a folder; its pages have 1200 x 750 pixels."""

    def __init__(self, binary: str, xvfb: str, profile: Path) -> None:
        profile.mkdir(exist_ok=True)
        lines = (f'user_pref("{name}", {json.dumps(value)});' for name, value in PREFERENCES.items())
        (profile / "user.js").write_text("\n".join(lines))
        self._log = profile / "log"
        self._process: subprocess.Popen[bytes] | None = None
        screen = [xvfb, "-displayfd", "1", "-screen", "0", "1700x1200x24", "-nolisten", "tcp"]
        self._screen = subprocess.Popen(screen, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
        try:
            assert self._screen.stdout is not None
            display = self._screen.stdout.readline().decode().strip()
            with self._log.open("wb") as log:
                self._process = subprocess.Popen(
                    [binary, "--marionette", "--remote-allow-system-access", "--no-remote", "--profile", str(profile)],
                    env={**os.environ, "DISPLAY": f":{display}"},
                    stdout=log,
                    stderr=subprocess.STDOUT,
                )
            super().__init__(Marionette(self._port(profile / "MarionetteActivePort")), options=FirefoxOptions())
            self.set_window_rect(0, 0, 1600, 1150)
            self._chrome(LISTEN)
            self.set_size()
        except BaseException:
            self._end()
            raise

    def quit(self) -> None:
        """End it and its screen."""
        try:
            super().quit()
            if self._process is not None:
                self._process.wait(PATIENCE_S)
        finally:
            self._end()

    def _end(self) -> None:
        for process in (self._process, self._screen):
            if process is not None:
                process.kill()
                process.wait()
        if self._screen.stdout is not None:
            self._screen.stdout.close()

    def set_size(self, width: int = 1200, height: int = 750) -> None:
        """Give pages so many pixels."""
        style = f"min-width: {width}px; max-width: {width}px; min-height: {height}px; max-height: {height}px"
        self._chrome(f"gBrowser.selectedBrowser.style = '{style}'")
        end = time.monotonic() + PATIENCE_S
        while self.execute_script("return [innerWidth, innerHeight]") != [width, height]:
            assert time.monotonic() < end, f"no page of {width} x {height}"
            time.sleep(0.02)

    def set_scheme(self, name: str) -> None:
        """Pretend that the user prefers "light" or "dark"."""
        self._chrome(f"Services.prefs.setIntPref('layout.css.prefers-color-scheme.content-override', {SCHEMES[name]})")

    @contextmanager
    def preference(self, name: str, value: bool) -> Iterator[None]:
        """Change a setting for a while."""
        self._chrome(f"Services.prefs.setBoolPref('{name}', {json.dumps(value)})")
        try:
            yield
        finally:
            self._chrome(f"Services.prefs.clearUserPref('{name}')")

    def errors(self) -> list[str]:
        """What the page complained of, and what was forbidden to it, since the last call."""
        params = {"script": COMPLAINTS, "args": [], "sandbox": "system"}
        return [str(message) for message in self.execute("w3cExecuteScript", params)["value"]]

    def requests(self) -> set[str]:
        """Addresses that pages asked a server for since the last call; reading a file is none."""
        return {str(address) for address in self._chrome(ASKED)}

    def _chrome(self, script: str) -> Any:
        """Run a script that may do what the browser itself may."""
        self.execute("setContext", {"value": "chrome"})
        try:
            return self.execute_script(script)
        finally:
            self.execute("setContext", {"value": "content"})

    def _port(self, told: Path) -> int:
        end = time.monotonic() + PATIENCE_S
        while not (told.exists() and told.read_text()):
            assert time.monotonic() < end, f"Firefox does not start: {self._log.read_text()}"
            time.sleep(0.05)
        return int(told.read_text())


def firefox(profile: Path) -> Firefox | None:
    """Start one; None where it or Xvfb is not on PATH."""
    binary = shutil.which("firefox-esr") or shutil.which("firefox")
    xvfb = shutil.which("Xvfb")
    return Firefox(binary, xvfb, profile) if binary and xvfb else None
