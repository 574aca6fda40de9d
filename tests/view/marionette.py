"""Firefox for Selenium without geckodriver, which Debian has not: Firefox speaks WebDriver itself, over a socket.

Its protocol (Marionette) is a length, a colon and JSON: [0, number, command, parameters] is answered by
[1, number, error, result]; geckodriver does little more than to translate HTTP into that.
"""

from __future__ import annotations

import json
import socket
from typing import Any

COMMANDS = {
    "newSession": "WebDriver:NewSession",
    "quit": "Marionette:Quit",
    "get": "WebDriver:Navigate",
    "screenshot": "WebDriver:TakeScreenshot",
    "w3cExecuteScript": "WebDriver:ExecuteScript",
    "findElement": "WebDriver:FindElement",
    "findElements": "WebDriver:FindElements",
    "findChildElement": "WebDriver:FindElement",
    "findChildElements": "WebDriver:FindElements",
    "clickElement": "WebDriver:ElementClick",
    "sendKeysToElement": "WebDriver:ElementSendKeys",
    "getCurrentUrl": "WebDriver:GetCurrentURL",
    "getElementText": "WebDriver:GetElementText",
    "getElementTagName": "WebDriver:GetElementTagName",
    "getElementAttribute": "WebDriver:GetElementAttribute",
    "getElementRect": "WebDriver:GetElementRect",
    "getElementValueOfCssProperty": "WebDriver:GetElementCSSValue",
    "getElementAriaLabel": "WebDriver:GetComputedLabel",
    "isElementSelected": "WebDriver:IsElementSelected",
    "isElementEnabled": "WebDriver:IsElementEnabled",
    "setWindowRect": "WebDriver:SetWindowRect",
    "actions": "WebDriver:PerformActions",
    "setContext": "Marionette:SetContext",
}
"""Selenium's names of those that the tests use."""
DEFAULTS: dict[str, dict[str, Any]] = {
    "quit": {"flags": ["eForceQuit"]},
    "screenshot": {"full": False},
}
PATIENCE_S = 60.0


class Marionette:
    """Carries Selenium's commands to a Firefox that listens on a port of this machine."""

    def __init__(self, port: int) -> None:
        self._socket = socket.create_connection(("127.0.0.1", port), PATIENCE_S)
        self._stream = self._socket.makefile("rb")
        self._sent = 0
        self._receive()  # the greeting

    def execute(self, command: str, params: dict[str, Any] | None) -> dict[str, Any]:
        """Send one of Selenium's commands; the answer as Selenium's error handler wants it."""
        given = {**DEFAULTS.get(command, {}), **(params or {})}
        given.pop("sessionId", None)
        if command.startswith("findChild"):
            given["element"] = given.pop("id")
        if command == "newSession":
            given = given["capabilities"]["alwaysMatch"]
        self._sent += 1
        packed = json.dumps([0, self._sent, COMMANDS[command], given]).encode()
        self._socket.sendall(b"%d:%s" % (len(packed), packed))
        _, _, error, result = self._receive()
        if error is not None:
            return {"status": error["error"], "value": error}
        plain = isinstance(result, dict) and set(result) == {"value"}
        return {"value": result["value"] if plain else result}

    def close(self) -> None:
        """End the connection; Selenium calls this last."""
        self._stream.close()
        self._socket.close()

    def _receive(self) -> Any:
        length = b""
        while not length.endswith(b":"):
            if not (byte := self._stream.read(1)):
                raise ConnectionError("Firefox has closed the connection")
            length += byte
        return json.loads(self._stream.read(int(length[:-1])))
