"""A phone with phyphox, on loopback: `python -m tests.record.phone [--rate HZ] [TASK]` serves a simulated hand.

Written from the app's documented behaviour (github.com/phyphox/phyphox-docs, docs/remote-interface): buffers of a
bounded size, thresholds, 8 digits, experiment time that stands still in a pause and begins anew when the data are
cleared. Beside that it has faults: no network, silence, answers of any kind.
"""

import argparse
import json
import threading
import time
from collections.abc import Mapping
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, Self
from urllib.parse import parse_qsl, urlsplit

import numpy as np

from pbd.data import Recording
from pbd.sensors.phyphox.answers import BUFFERS
from tests.tracking.tapping import tapped

Streams = Mapping[str, tuple[np.ndarray, np.ndarray]]
"""Of each sensor its times (n,) s and readings (n, 3)."""


def streams_of(hands: Mapping[str, Recording]) -> Streams:
    """The sensors of simulations at rates of their own, not in step: each begins a little later than the one before."""
    return {
        kind: (hands[kind].t + 0.0013 * k, np.asarray(getattr(hands[kind], kind)))
        for k, kind in enumerate(("acc", "gyr", "mag"))
        if kind in hands
    }


class Phone:
    """A phone that plays streams into phyphox' buffers in real time.

    Attributes:
        offline: it takes no connection; what comes is hung up on.
        body: what it answers to /get instead of buffers; a callable may write as it likes.
        asked: every request so far.
        pressed: what was pressed, and when on the computer's monotonic clock, s.
    """

    def __init__(self, streams: Streams, size: int = 60_000, names: Mapping[str, tuple[str, ...]] = BUFFERS) -> None:
        self.streams, self.size, self.names = dict(streams), size, names
        self.offline, self.body, self.asked = False, b"", list[str]()
        self.moments: list[dict[str, Any]] = []
        self.pressed: list[tuple[str, float]] = []
        self._epoch = time.time() - time.monotonic()  # UTC where the monotonic clock is 0, s
        self._run = 0.0  # experiment time at the last start, s
        self._started: float | None = None
        self._from = 0.0  # s of the streams that were cleared
        self._lock = threading.RLock()
        phone = self

        class Handler(BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"

            def do_GET(self) -> None:
                phone.asked.append(self.path)
                if phone.offline:
                    self.close_connection = True
                    return
                path, query = urlsplit(self.path).path, dict(parse_qsl(urlsplit(self.path).query, True))
                text = (
                    phone.body if path == "/get" and phone.body and "full" not in query else phone.answer(path, query)
                )
                if callable(text):
                    text(self)
                    return
                self.send_response(200 if text else 404)
                self.send_header("Content-Type", "application/json")
                self.send_header("Content-Length", str(len(text)))
                self.end_headers()
                self.wfile.write(text)

            def log_message(self, *args: Any) -> None:
                pass

        self._server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self._server.daemon_threads = True
        self._thread = threading.Thread(target=self._server.serve_forever, args=(0.02,), daemon=True)
        self.address = f"http://127.0.0.1:{self._server.server_port}"

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()

    @property
    def t(self) -> float:
        """Experiment time, s."""
        return self._run + (0.0 if self._started is None else time.monotonic() - self._started)

    def start(self) -> None:
        """Press play."""
        with self._lock:
            if self._started is None:
                self._started = time.monotonic()
                self._mark("START", self._started)

    def pause(self) -> None:
        """Press pause."""
        with self._lock:
            if self._started is not None:
                now = time.monotonic()
                self._run, self._started = self._run + now - self._started, None
                self._mark("PAUSE", now)

    def clear(self) -> None:
        """Press the bin: it stops, and time begins anew."""
        with self._lock:
            self._from += self.t
            self._run, self._started = 0.0, None
            self.moments = []

    def _mark(self, event: str, now: float) -> None:
        self.pressed.append((event, now))
        moment = {"event": event, "experimentTime": self._run, "systemTime": self._epoch + now, "systemTimeString": ""}
        self.moments.append(moment)

    def answer(self, path: str, query: Mapping[str, str]) -> Any:
        """What the app answers."""
        with self._lock:
            if path == "/get":
                return self.buffers(query)
            if path == "/control":
                getattr(self, {"start": "start", "stop": "pause", "clear": "clear"}[query["cmd"]])()
                return b'{"result": true}'
            if path == "/time":
                return json.dumps(self.moments).encode()
            return json.dumps({"deviceModel": "Test Phone", "version": "1.2.0"}).encode() if path == "/meta" else b""

    def buffers(self, query: Mapping[str, str]) -> bytes:
        """Answer /get: each buffer's last number, all of it, or what belongs to a later reference than a threshold."""
        columns: dict[str, np.ndarray] = {}
        for kind, names in self.names.items():
            t, values = self.streams.get(kind, (np.empty(0), np.empty((0, 3))))
            there = (t >= self._from) & (t < self._from + self.t)
            rows = np.column_stack((t[there] - self._from, values[there]))[-self.size :]
            columns |= dict(zip(names, rows.T, strict=True))
        told = {}
        for name, asked in query.items():
            if name not in columns:
                continue
            column, mode = columns[name], "partial"
            if not asked:
                column, mode = column[-1:], "single"
            elif asked == "full":
                mode = "full"
            else:
                since, _, reference = asked.partition("|")
                threshold = float(since)
                threshold += 10.0 ** np.floor(np.log10(abs(threshold) / 1e7)) if threshold else 0.0
                column = column[columns[reference or name] > threshold]
            told[name] = {"size": self.size, "updateMode": mode, "buffer": [float(f"{x:.7e}") for x in column]}
        status = {"session": "abc", "measuring": self._started is not None, "timedRun": False, "countDown": 0}
        return json.dumps({"buffer": told, "status": status}).encode()


def main() -> None:
    """Serve a simulated hand until Ctrl-C; it taps the phone's back where the task grips."""
    from pbd.simulation.simulate import simulate

    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("task", nargs="?", default="pour")
    parser.add_argument("--rate", type=float, default=200.0)
    args = parser.parse_args()
    rates = {"gyr": args.rate, "acc": args.rate, "mag": 50.0}
    hands = {kind: simulate(args.task, "phone", 1, rate_hz=hz).recording for kind, hz in rates.items()}
    taps = [(event.t + late, 40.0) for event in hands["acc"].grip for late in (0.0, 0.25)]
    with Phone(streams_of(hands | {"acc": tapped(hands["acc"], taps)})) as phone:
        print(f"a simulated phone at {phone.address}", flush=True)
        threading.Event().wait()


if __name__ == "__main__":
    main()
