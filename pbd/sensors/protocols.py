"""The registry: what speaks which protocol, how fast, and how to ask it to be faster.

Nothing heavy is loaded until a decoder is made. Baud rates are in the order in which to try them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from pbd.errors import SensorError, nearest
from pbd.sensors.decoding import Decoder

COMMAND_PAUSE_S = 0.25
"""To wait after each command, as the drivers of the OS5000 do (ACFR's); WitMotion's own code waits 1 to 100 ms."""


@dataclass(frozen=True)
class WireProtocol:
    """What a kind of device speaks.

    Attributes:
        title: the devices' names.
        decoder: makes a decoder at its start.
        bauds: to try, in this order; the first is the maker's default.
        fastest_hz: samples a second, at most.
        gives, lacks: for people.
        rate_commands: the bytes that set each rate that can be asked for, to be sent in this order with
            COMMAND_PAUSE_S after each.
        rate_note: what is to be known of its rate, for people.
    """

    title: str
    decoder: Callable[[], Decoder]
    bauds: tuple[int, ...]
    fastest_hz: int
    gives: str
    lacks: str
    rate_commands: Mapping[int, tuple[bytes, ...]] = field(default_factory=dict)
    rate_note: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "rate_commands", MappingProxyType(dict(self.rate_commands)))

    def commands_for(self, rate_hz: float) -> tuple[bytes, ...]:
        """Return the bytes that set this rate.

        Raises:
            SensorError: the device has no such rate, or none can be set from here.
        """
        for rate, commands in self.rate_commands.items():
            if rate == rate_hz:
                return commands
        if not self.rate_commands:
            raise SensorError(f"the rate of {self.title} can't be set from here; set it with the maker's program")
        raise SensorError(
            f"{self.title} has no rate of {rate_hz:g} Hz; ask for {_listed(self.rate_commands)} Hz", value=rate_hz
        )


def _os5000() -> Decoder:
    from pbd.sensors.os5000 import OS5000Decoder

    return OS5000Decoder()


def _witmotion() -> Decoder:
    from pbd.sensors.witmotion import WitMotionDecoder

    return WitMotionDecoder()


def _ximu3() -> Decoder:
    from pbd.sensors.ximu3 import XImu3Decoder

    return XImu3Decoder()


def _vectornav() -> Decoder:
    from pbd.sensors.vectornav import VectorNavDecoder

    return VectorNavDecoder()


def _xsens() -> Decoder:
    from pbd.sensors.xsens import XsensDecoder

    return XsensDecoder()


def _lines() -> Decoder:
    raise SensorError('sensor "lines" needs the names of its columns; add --columns "ax,ay,az,gx,gy,gz" or a TOML file')


def _razor() -> Decoder:
    from pbd.sensors.lines import LineDecoder
    from pbd.sensors.razor import razor_layout

    return LineDecoder(razor_layout())


def _os5000_rate(hz: int) -> tuple[bytes, ...]:
    """ESC R n, ended by a space (Users Guide, command summary: 1 to 40 samples a second)."""
    return (b"\x1bR%d " % hz,)


WITMOTION_RATES = {1: 0x03, 2: 0x04, 5: 0x05, 10: 0x06, 20: 0x07, 50: 0x08, 100: 0x09, 200: 0x0B}
"""Register RRATE by Hz, where the maker's sheets agree (one has 0x0A for 125 Hz)."""


def _witmotion_rate(code: int) -> tuple[bytes, ...]:
    """Unlock, write register 3, save (WIT Standard Communication Protocol: FF AA register low high)."""
    return (b"\xff\xaa\x69\x88\xb5", bytes((0xFF, 0xAA, 0x03, code, 0x00)), b"\xff\xaa\x00\x00\x00")


PROTOCOLS: Mapping[str, WireProtocol] = MappingProxyType(
    {
        "os5000": WireProtocol(
            title="OceanServer OS5000, OS500, OS4000",
            decoder=_os5000,
            bauds=(19200, 38400, 115200, 57600, 9600, 4800),
            fastest_hz=40,
            gives="acceleration, field, heading, pitch, roll",
            lacks="gyro, clock; its field means nothing before the field calibration",
            rate_commands={hz: _os5000_rate(hz) for hz in range(1, 41)},
            rate_note="24 Hz at 19200 baud with field and acceleration",
        ),
        "witmotion": WireProtocol(
            title="WitMotion WT901, JY901, HWT905, WT61",
            decoder=_witmotion,
            bauds=(9600, 115200, 230400, 921600, 57600, 38400, 19200),
            fastest_hz=200,
            gives="acceleration, gyro, attitude; field but for WT61",
            lacks="clock; a unit of its field",
            rate_commands={hz: _witmotion_rate(code) for hz, code in WITMOTION_RATES.items()},
            rate_note="21 Hz at 9600 baud; a WT61 does not take these commands",
        ),
        "ximu3": WireProtocol(
            title="x-io x-IMU3",
            decoder=_ximu3,
            bauds=(115200, 921600, 460800, 230400),
            fastest_hz=400,
            gives="acceleration, gyro, field, attitude, clock",
            lacks="checksum; a unit of its field",
            rate_note="400 divided by a whole number; the field at 20 Hz",
        ),
        "vectornav": WireProtocol(
            title="VectorNav VN-100",
            decoder=_vectornav,
            bauds=(115200, 921600, 460800, 230400, 57600, 9600),
            fastest_hz=800,
            gives="acceleration, gyro, field, attitude; in binary its clock",
            lacks="clock in ASCII",
            rate_note="to 200 Hz in ASCII, 800 in binary",
        ),
        "xsens": WireProtocol(
            title="Xsens MTi (MTData2)",
            decoder=_xsens,
            bauds=(115200, 921600, 2000000, 460800, 230400, 57600),
            fastest_hz=2000,
            gives="acceleration, gyro, field, attitude, clock",
            lacks="a unit of its field",
            rate_note="to 400 Hz with attitude, MTi-1 series 100 Hz",
        ),
        "lines": WireProtocol(
            title="any device that prints numbers (Arduino)",
            decoder=_lines,
            bauds=(115200, 9600, 57600, 230400, 250000, 500000, 1000000, 38400, 19200),
            fastest_hz=1000,
            gives="what its columns are said to be",
            lacks="checksum",
            rate_note="what the sketch prints",
        ),
        "razor": WireProtocol(
            title="SparkFun Razor, 9DOF Sensor Stick (Razor AHRS)",
            decoder=_razor,
            bauds=(57600, 115200),
            fastest_hz=50,
            gives="acceleration, gyro, field",
            lacks="checksum, clock, attitude beside these; a unit of its field",
            rate_note="fixed in its firmware",
        ),
    }
)


def protocol(name: str, also: Iterable[str] = ()) -> WireProtocol:
    """Return the protocol of this name.

    Args:
        name: as in `pbd record --sensor`.
        also: what the caller takes beside protocols, for the error.

    Raises:
        SensorError: there is none.
    """
    if name not in PROTOCOLS:
        known = (*also, *PROTOCOLS)
        raise SensorError(
            f"sensor {name!r} is unknown; the sensors are {', '.join(known)}{nearest(name, known)}", value=name
        )
    return PROTOCOLS[name]


def protocol_table() -> str:
    """Return the registry as a Markdown table (docs/sensors.md)."""
    rows = [
        f"| `{name}` | {one.title} | {_rates(one)} | {', '.join(map(str, one.bauds))} | {one.gives} | {one.lacks} |"
        for name, one in PROTOCOLS.items()
    ]
    head = "| `--sensor` | device | rate, Hz | baud, in the order tried | gives | lacks |"
    return "\n".join((head, "|---" * 6 + "|", *rows)) + "\n"


def _rates(one: WireProtocol) -> str:
    settable = f"settable: {_listed(one.rate_commands)}" if one.rate_commands else f"at most {one.fastest_hz}"
    return "; ".join(filter(None, (settable, one.rate_note)))


def _listed(rates: Mapping[int, object]) -> str:
    """Name the rates: 1 to 40, or each of them."""
    ordered = sorted(rates)
    if ordered == list(range(ordered[0], ordered[-1] + 1)) and len(ordered) > 2:
        return f"{ordered[0]} to {ordered[-1]}"
    return ", ".join(map(str, ordered))
