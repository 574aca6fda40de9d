"""A phone that runs phyphox, asked over HTTP. Nothing here listens: the phone is the server.

The phone keeps its samples for minutes (`experiment.ROWS`), so a network that is lost for a while costs none.
"""

from __future__ import annotations

import http.client
import time
from contextlib import suppress
from math import inf
from typing import Any
from urllib.parse import urlsplit

from pbd.data.streams import Moments
from pbd.errors import SensorError, printable
from pbd.sensors.phyphox.answers import (
    BUFFERS,
    LONGEST_ANSWER,
    LONGEST_RUN_S,
    in_order,
    read_answer,
    read_buffers,
    read_moments,
)
from pbd.sensors.reader import Source

POLL_S = 0.1
"""s between two requests: the recording's screen is drawn as often."""

ANSWER_S = 4.0
"""Longest time, s, that the whole of an answer may take."""

CONNECT_S = 2.0
"""Longest time, s, without a byte on the connection."""

PATIENCE_S = 30.0
"""s without a sample after which the phone counts as lost. It takes about ten to join a Wi-Fi again."""

PIECE = 65536
"""Bytes of an answer that are read at once."""

SCAN = "scan the code of `pbd sensors phyphox` with the app, open it, and allow remote access in its menu"


class PhonePort(Source):
    """phyphox on a phone, as a port that gives the phone's answers.

    Attributes:
        device: its address.
        patience_s: s without an answer after which the reader gives up.
        trouble: why no samples come now, or "".
        model: what the phone is called.
    """

    patience_s = PATIENCE_S + 2.0 * ANSWER_S  # `read` knows better, and first

    def __init__(self, address: str) -> None:
        """Connect, and start the measurement if it does not run.

        SensorError: no such address, nobody answers, no phyphox answers, or another experiment is open.
        """
        self.device, self.trouble = address.rstrip("/"), ""
        self._host, self._port = _host_and_port(self.device)
        self._connection: http.client.HTTPConnection | None = None
        self._moments, self._last, self._due, self._silent_since = Moments(), dict.fromkeys(BUFFERS, -inf), 0.0, inf
        self._told = b""
        self.connect()

    def connect(self) -> None:
        """Connect, for the first time or again: then it goes on with the first sample that was not read yet."""
        self._silent_since = inf
        try:
            self._open()
        except SensorError:
            self.close()
            raise
        except (OSError, http.client.HTTPException) as reason:
            raise SensorError(
                f"{self.device} does not answer ({_why(reason)}): {SCAN}; the phone and this computer must be in "
                "the same Wi-Fi",
                path=self.device,
            ) from None
        except ValueError:
            self.close()
            raise SensorError(f"what answers at {self.device} is no phyphox: {SCAN}", path=self.device) from None

    def _open(self) -> None:
        text = self._ask("/get?" + "&".join(names[0] for names in BUFFERS.values()))
        answer = read_answer(text)
        buffers = answer.get("buffer") if isinstance(answer, dict) else None
        if not isinstance(buffers, dict):
            raise ValueError("no buffers")
        if BUFFERS["acc"][0] not in buffers:
            raise SensorError(f"another experiment than pbd's is open on {self.device}: {SCAN}", path=self.device)
        try:
            self.model = _name(read_answer(self._ask("/meta")))
            read_moments(read_answer(self._ask("/time")))
        except ValueError:
            raise SensorError(
                f"phyphox on {self.device} tells no times (/time), which it does from version 1.1.8 on: update the app",
                path=self.device,
            ) from None
        if not self._told:
            for kind, names in BUFFERS.items():
                with suppress(TypeError, KeyError, IndexError, OverflowError):
                    self._last[kind] = float(buffers[names[0]]["buffer"][-1])
        if max(self._last.values()) > 0.9 * LONGEST_RUN_S:
            raise SensorError(
                f"the measurement on {self.device} has run for more than a day, and phyphox tells its time by 8 "
                "digits: clear its data",
                path=self.device,
            )
        if not _measures(answer) and read_answer(self._ask("/control?cmd=start")) != {"result": True}:
            what = f"phyphox on {self.device} does not start to measure: press its play button"
            raise SensorError(what, path=self.device)

    def read(self) -> bytes:
        """Return what is new, after POLL_S if the phone answers; SensorError: nothing has come for PATIENCE_S."""
        now = time.monotonic()
        if now < self._due:
            time.sleep(min(self._due - now, POLL_S))
        self._due = max(self._due + POLL_S, time.monotonic())
        try:
            data = self._poll()
        except (OSError, http.client.HTTPException) as reason:
            data = b""
            self.trouble = f"the phone does not answer ({_why(reason)}); is its screen on, and its Wi-Fi?"
            self.close()
        except ValueError:
            data = b""
            self.trouble = "the phone's answers make no sense; is it phyphox, with pbd's experiment open?"
        now = time.monotonic()
        self._silent_since = inf if data else min(self._silent_since, now)
        if now - self._silent_since > PATIENCE_S:
            raise SensorError(f"{self.device} is gone: {self.trouble}", path=self.device, lost=True)
        return data

    def _poll(self) -> bytes:
        """Ask for the moments first: a sample that came after a pause is never taken for one before it."""
        told = self._ask("/time")
        moments = read_moments(read_answer(told))
        if self._moments.take(moments):
            self._last = dict.fromkeys(BUFFERS, -inf)
        text = self._ask("/get?" + "&".join(self._wanted()))
        answer = read_answer(text)
        rows = read_buffers(answer)
        if "acc" not in rows:
            self.trouble = "another experiment is open on the phone; open pbd's again"
            return b""
        new = False
        for kind, each in rows.items():
            times = each[:, 0][(each[:, 0] >= 0.0) & (each[:, 0] < LONGEST_RUN_S)]
            if taken := in_order(times, self._last[kind]):
                new, self._last[kind] = True, float(times[taken[-1]])
        if not new:
            paused = "the measurement is paused on the phone; press its play button"
            self.trouble = "the phone sends no new samples" if _measures(answer) else paused
            return b""
        self.trouble = ""
        before, self._told = self._told, told
        return (b"" if told == before else b"/time " + _one_line(told)) + b"/get " + _one_line(text)

    def _wanted(self) -> list[str]:
        words = []
        for kind, (t, *axes) in BUFFERS.items():
            last = self._last[kind]
            since = "full" if last == -inf else f"{last:.8g}"
            words.append(f"{t}={since}")
            words += [f"{axis}={since}" if last == -inf else f"{axis}={since}%7C{t}" for axis in axes]
        return words

    def _ask(self, path: str) -> bytes:
        """The body of an answer, within ANSWER_S and LONGEST_ANSWER; ValueError: it is an error, or too long."""
        until = time.monotonic() + ANSWER_S
        if self._connection is None:
            self._connection = http.client.HTTPConnection(self._host, self._port, timeout=CONNECT_S)
        try:
            self._connection.request("GET", path, headers={"Accept": "application/json"})
            response = self._connection.getresponse()
            body = bytearray()
            while piece := response.read1(PIECE):
                body += piece
                if len(body) > LONGEST_ANSWER:
                    raise ValueError("an answer without end")
                if time.monotonic() > until:
                    raise TimeoutError("timed out")
            response.close()
            if response.status != http.client.OK:
                raise ValueError(f"status {response.status}")
        except BaseException:
            self.close()
            raise
        if response.will_close:
            self.close()
        return bytes(body)

    def close(self) -> None:
        """Hang up; the phone goes on to measure."""
        if self._connection is not None:
            with suppress(OSError):
                self._connection.close()
            self._connection = None


def _host_and_port(address: str) -> tuple[str, int]:
    try:
        parts = urlsplit(address)
        host, port = parts.hostname, parts.port
    except ValueError:
        parts, host, port = None, None, None
    if parts is None or host is None or parts.scheme != "http" or parts.path or parts.query or parts.username:
        raise SensorError(
            f"'{printable(address)}' is no address of a phone; give it as phyphox shows it, such as "
            "http://192.168.1.20:8080",
            value=address,
        )
    return host, 80 if port is None else port


def _measures(answer: object) -> bool:
    try:
        return answer["status"]["measuring"] is True  # type: ignore[index]
    except (TypeError, KeyError):
        return False


def _name(meta: Any) -> str:
    model = meta.get("deviceModel") if isinstance(meta, dict) else None
    return printable(model)[:40].strip() if isinstance(model, str) else ""


def _one_line(text: bytes) -> bytes:
    return b" ".join(text.split()) + b"\n"


def _why(reason: Exception) -> str:
    if isinstance(reason, TimeoutError):
        return "timed out"
    text = getattr(reason, "strerror", None) or str(reason) or type(reason).__name__
    return printable(str(text))[:80]
