"""HTTP client of a phone that runs phyphox. The phone is the server.

The phone keeps its samples for minutes (`experiment.BUFFER_ROWS`), so a short loss of the network loses no sample.
"""

import http.client
import socket
import time
from contextlib import suppress
from math import inf
from typing import Any, Self
from urllib.parse import urlsplit

from pbd.data.paused_clock import PausedClock
from pbd.errors import SensorError, in_words, printable
from pbd.sensors.phyphox.answers import (
    BUFFERS,
    LONGEST_ANSWER,
    MAX_RUN_S,
    read_answer,
    read_buffers,
    read_clock_events,
    trusted_rows,
)
from pbd.sensors.reader import ByteSource

POLL_S = 0.1
"""Time between two requests, s: as often as the recording's screen is drawn."""

ANSWER_S = 4.0
"""Longest time for a whole answer, s."""

SILENT_S = 2.0
"""Longest time without a byte of an answer, s."""

PATIENCE_S = 30.0
"""Time without a sample after which the phone counts as lost, s. To rejoin a Wi-Fi takes about 10 s."""

SCAN_HINT = "scan the code of `pbd sensors phyphox` with the app, open it, and allow remote access in its menu"


class PhonePort(ByteSource):
    """phyphox on a phone, as a port whose bytes are the phone's answers; `model`: the phone's model name, or ""."""

    patience_s = PATIENCE_S + 2.0 * ANSWER_S  # longer than the wait of `read`, whose error says more

    def __init__(self, address: str) -> None:
        """Connect, and start the measurement if it does not run.

        SensorError: no such address, nobody answers, no phyphox answers, or another experiment is open.
        """
        self.device, self.trouble = address.rstrip("/"), ""
        self._host, self._port = _host_and_port(self.device)
        self._connection: http.client.HTTPConnection | None = None
        self._clock, self._last_t, self._due, self._silent_since = PausedClock(), dict.fromkeys(BUFFERS, -inf), 0.0, inf
        self._last_events = b""
        self.connect()

    def connect(self) -> Self:
        """Connect, or connect again and continue with the first sample that was not read yet; return the port."""
        self._silent_since = inf
        try:
            self._open()
        except SensorError:
            self.close()
            raise
        except (OSError, http.client.HTTPException) as reason:
            what = f"{self.device} does not answer ({printable(in_words(reason))}): {SCAN_HINT}; the phone and this"
            raise SensorError(f"{what} computer must be in the same Wi-Fi", path=self.device) from None
        except ValueError:
            self.close()
            raise SensorError(f"what answers at {self.device} is no phyphox: {SCAN_HINT}", path=self.device) from None
        return self

    def _open(self) -> None:
        text = self._get("/get?" + "&".join(names[0] for names in BUFFERS.values()))
        answer = read_answer(text)
        buffers = answer.get("buffer") if isinstance(answer, dict) else None
        if not isinstance(buffers, dict):
            raise ValueError("no buffers")
        if BUFFERS["acc"][0] not in buffers:
            raise SensorError(f"another experiment than pbd's is open on {self.device}: {SCAN_HINT}", path=self.device)
        try:
            meta = read_answer(self._get("/meta"))
            model = meta.get("deviceModel") if isinstance(meta, dict) else None
            self.model = printable(model)[:40].strip() if isinstance(model, str) else ""
            read_clock_events(read_answer(self._get("/time")))
        except ValueError:
            what = f"phyphox on {self.device} does not report its times (/time), as version 1.1.8 and later do"
            raise SensorError(f"{what}: update the app", path=self.device) from None
        if not self._last_events:
            for kind, names in BUFFERS.items():
                with suppress(TypeError, KeyError, IndexError, OverflowError):
                    self._last_t[kind] = float(buffers[names[0]]["buffer"][-1])
        if not _is_measuring(answer) and read_answer(self._get("/control?cmd=start")) != {"result": True}:
            what = f"phyphox on {self.device} does not start to measure: press its play button"
            raise SensorError(what, path=self.device)

    def read(self) -> bytes:
        """Return new answers, at most one poll each POLL_S; SensorError: no sample has come for PATIENCE_S."""
        now = time.monotonic()
        if now < self._due:
            time.sleep(min(self._due - now, POLL_S))
        self._due = max(self._due + POLL_S, time.monotonic())
        try:
            data = self._poll()
        except (OSError, http.client.HTTPException) as reason:
            data = b""
            why = printable(in_words(reason))
            self.trouble = f"the phone does not answer ({why}); is its screen on, and its Wi-Fi?"
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
        """Poll once. It asks for the events first, so that no sample after a pause counts as one before it."""
        events = self._get("/time")
        if self._clock.take(read_clock_events(read_answer(events))):
            self._last_t = dict.fromkeys(BUFFERS, -inf)
        text = self._get("/get?" + "&".join(self._query()))
        answer = read_answer(text)
        rows = read_buffers(answer)
        if "acc" not in rows:
            self.trouble = "another experiment is open on the phone; open pbd's again"
            return b""
        new = False
        for kind, each in rows.items():
            times = each[:, 0][(each[:, 0] >= 0.0) & (each[:, 0] < MAX_RUN_S)]
            if trusted := trusted_rows(times, self._last_t[kind]):
                new, self._last_t[kind] = True, float(times[trusted[-1]])
        if not new:
            paused = "the measurement is paused on the phone; press its play button"
            self.trouble = "the phone sends no new samples" if _is_measuring(answer) else paused
            return b""
        self.trouble = ""
        before, self._last_events = self._last_events, events
        return (b"" if events == before else b"/time " + _one_line(events)) + b"/get " + _one_line(text)

    def _query(self) -> list[str]:
        """Ask for the full buffers at first, later for the rows whose time (`|` t) is after the last one."""
        query = []
        for kind, (t, *axes) in BUFFERS.items():
            last = self._last_t[kind]
            since, by_time = ("full", "") if last == -inf else (f"{last:.8g}", f"%7C{t}")
            query += [f"{t}={since}", *(f"{axis}={since}{by_time}" for axis in axes)]
        return query

    def _get(self, path: str) -> bytes:
        """Get an answer's body within ANSWER_S and LONGEST_ANSWER; ValueError: an error status, or too long."""
        if self._connection is None:
            self._connection = _Connection(self._host, self._port, timeout=SILENT_S)
        try:
            self._connection.request("GET", path, headers={"Accept": "application/json"})
            response = self._connection.getresponse()
            body = bytearray()
            while piece := response.read1(65536):
                body += piece
                if len(body) > LONGEST_ANSWER:
                    raise ValueError("an answer without end")
            response.close()
            if response.status != http.client.OK:
                raise ValueError(f"status {response.status}")
        except BaseException:
            self.close()
            raise
        return bytes(body)

    def close(self) -> None:
        """Close the connection; the phone continues to measure."""
        if self._connection is not None:
            with suppress(OSError):
                self._connection.close()
            self._connection = None


class _Connection(http.client.HTTPConnection):
    """A connection that ends ANSWER_S after a request, also while the answer's header drips."""

    def connect(self) -> None:
        super().connect()
        self.sock = _Socket(fileno=self.sock.detach())


class _Socket(socket.socket):
    def sendall(self, *args: Any) -> None:
        self._until = time.monotonic() + ANSWER_S
        self.settimeout(SILENT_S)
        super().sendall(*args)

    def recv_into(self, *args: Any) -> int:
        left = self._until - time.monotonic()
        if left <= 0.0:
            raise TimeoutError("timed out")
        self.settimeout(min(left, SILENT_S))
        return super().recv_into(*args)


def _host_and_port(address: str) -> tuple[str, int]:
    with suppress(ValueError):
        parts = urlsplit(address)
        if parts.hostname and parts.scheme == "http" and not (parts.path or parts.query or parts.username):
            return parts.hostname, 80 if parts.port is None else parts.port
    what = f"'{printable(address)}' is no address of a phone; give it as phyphox shows it, such as"
    raise SensorError(f"{what} http://192.168.1.20:8080", value=address)


def _is_measuring(answer: object) -> bool:
    try:
        return answer["status"]["measuring"] is True  # type: ignore[index]
    except (TypeError, KeyError):
        return False


def _one_line(text: bytes) -> bytes:
    return b" ".join(text.split()) + b"\n"
