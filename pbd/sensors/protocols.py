"""The registry of sensors: their protocols, baud rates, and the commands that set their sampling rates.

Nothing heavy is imported until a decoder is made.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pkgutil import resolve_name

from pbd.errors import SensorError, UsageError, nearest
from pbd.sensors.decoding import Decoder

COMMAND_PAUSE_S = 0.25
"""Time to wait after each command, s, as in ACFR's driver of the OS5000. WitMotion's own code waits 1 to 100 ms."""


@dataclass(frozen=True)
class WireProtocol:
    """A kind of device and its protocol. How large its errors are is in CLASSES of pbd/tracking/noise.py, by its name.

    Attributes:
        decoder_path: "module:name" of the decoder in this package; "" if it can't be made without options.
        bauds: baud rates in the order to try them, the maker's default first; empty for a device without a serial port.
        gives: the quantities that it sends, for people.
        rate_commands: for each rate in Hz, the commands to send in this order, with COMMAND_PAUSE_S after each.
    """

    title: str
    decoder_path: str
    bauds: tuple[int, ...]
    gives: str
    rate_commands: Mapping[int, tuple[bytes, ...]] = field(default_factory=dict)

    def decoder(self) -> Decoder:
        """Make a new decoder."""
        if not self.decoder_path:
            what = 'sensor "lines" needs the names of its columns'
            raise SensorError(f'{what}; add --columns "ax,ay,az,gx,gy,gz" or a TOML file')
        decoder: Decoder = resolve_name(f"pbd.sensors.{self.decoder_path}")()
        return decoder

    def commands_for(self, rate_hz: float) -> tuple[bytes, ...]:
        """Return the commands that set this rate; SensorError: the device has no such rate, or pbd can't set it."""
        if not self.rate_commands:
            raise SensorError(f"the rate of {self.title} can't be set from here; set it with the maker's program")
        if rate_hz not in self.rate_commands:
            rates = sorted(self.rate_commands)
            known = f"1 to {len(rates)}" if rates[-1] == len(rates) else ", ".join(map(str, rates))
            raise SensorError(f"{self.title} has no rate of {rate_hz:g} Hz; ask for {known} Hz", value=rate_hz)
        return self.rate_commands[int(rate_hz)]


PROTOCOLS: Mapping[str, WireProtocol] = {
    "os5000": WireProtocol(
        title="OceanServer OS5000, OS500, OS4000",
        decoder_path="os5000:OS5000Decoder",
        bauds=(19200, 38400, 115200, 57600, 9600, 4800),
        gives="acceleration, field, heading, pitch, roll",
        # ESC R n and a space (Users Guide, command summary: 1 to 40 samples a second)
        rate_commands={hz: (b"\x1bR%d " % hz,) for hz in range(1, 41)},
    ),
    "witmotion": WireProtocol(
        title="WitMotion WT901, JY901, HWT905, WT61, WT901BLE",
        decoder_path="witmotion:WitMotionDecoder",
        bauds=(9600, 115200, 230400, 921600, 57600, 38400, 19200),
        gives="acceleration, gyro, attitude; field (not the WT61, WT901BLE)",
        # unlock, write register 3, save (WIT Standard Communication Protocol: FF AA, register, low byte, high byte)
        rate_commands={
            hz: (b"\xff\xaa\x69\x88\xb5", bytes((0xFF, 0xAA, 0x03, code, 0x00)), b"\xff\xaa\x00\x00\x00")
            # rate in Hz -> RRATE, where the data sheets agree (one has 0x0A for 125 Hz)
            for hz, code in {1: 3, 2: 4, 5: 5, 10: 6, 20: 7, 50: 8, 100: 9, 200: 0x0B}.items()
        },
    ),
    "ximu3": WireProtocol(
        title="x-io x-IMU3",
        decoder_path="ximu3:XImu3Decoder",
        bauds=(115200, 921600, 460800, 230400),
        gives="acceleration, gyro, field, attitude, clock",
    ),
    "vectornav": WireProtocol(
        title="VectorNav VN-100",
        decoder_path="vectornav:VectorNavDecoder",
        bauds=(115200, 921600, 460800, 230400, 57600, 9600),
        gives="acceleration, gyro, field, attitude; in binary its clock",
    ),
    "xsens": WireProtocol(
        title="Xsens MTi (MTData2)",
        decoder_path="xsens:XsensDecoder",
        bauds=(115200, 921600, 2000000, 460800, 230400, 57600),
        gives="acceleration, gyro, field, attitude, clock",
    ),
    "lines": WireProtocol(
        title="any device that prints numbers (Arduino)",
        decoder_path="",
        bauds=(115200, 9600, 57600, 230400, 250000, 500000, 1000000, 38400, 19200),
        gives="the channels that its columns name",
    ),
    "razor": WireProtocol(
        title="SparkFun Razor, 9DOF Sensor Stick (Razor AHRS)",
        decoder_path="razor:razor_decoder",
        bauds=(57600, 115200),
        gives="acceleration, gyro, field",
    ),
    "phyphox": WireProtocol(
        title="a phone with the app phyphox",
        decoder_path="phyphox.answers:PhyphoxDecoder",
        bauds=(),
        gives="acceleration, gyro, field where it has one, clock",
    ),
    "gamepad": WireProtocol(
        title="DualSense, DualShock 4, Joy-Con, Switch Pro Controller (Linux)",
        decoder_path="gamepad:GamepadDecoder",
        bauds=(),
        gives="acceleration, gyro, clock; its buttons mark the grip",
    ),
}


def protocol(name: str, also: Iterable[str] = ()) -> WireProtocol:
    """Look up a sensor's protocol. UsageError: unknown; its message lists the names, with those of `also` first."""
    if name not in PROTOCOLS:
        known = (*also, *PROTOCOLS)
        models = (key for key, each in PROTOCOLS.items() if name.lower() in each.title.lower().replace(",", "").split())
        hint = "".join(f"; did you mean {key}?" for key in models) or nearest(name, known)
        raise UsageError(f"sensor {name!r} is unknown; the sensors are {', '.join(known)}{hint}", value=name)
    return PROTOCOLS[name]
