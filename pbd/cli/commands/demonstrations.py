"""Options of the commands that make demonstrations: record, simulate, import; and of sensors."""

import sys
from argparse import ArgumentParser
from pathlib import Path

from pbd.cli.options import (
    JSON,
    REPLACE_DEMO,
    AppendOnce,
    add_line_options,
    add_table,
    flag,
    integer,
    option,
    pair,
    positive,
)


def record(parser: ArgumentParser) -> None:
    """Record a demonstration from a sensor.

    Record to ./demos/NAME, sample by sample. Hold still for two seconds, then move, stop, move, stop.
    At a terminal: Enter ends the recording, space marks that the grip closes or opens, q asks and discards
    the recording. Ctrl-C ends it as Enter does.
    `--sensor sim` simulates a hand that does a TASK (pour) and grips by itself.

      pbd record tea --sensor witmotion
      pbd record tea --sensor sim:pour           without hardware: a simulated hand that pours
      pbd record tea --sensor phyphox --port http://192.168.1.20:8080 --grip tap       from a phone
      pbd record tea --sensor gamepad            a DualSense, DualShock 4 or Joy-Con; its buttons mark the grip
      pbd record tea --live                      and see the hand, its path and its stops in the browser
      pbd record tea --sensor lines --columns "t,ax,ay,az,gx,gy,gz" --unit t=ms --unit acc=g --unit gyr=deg/s
    """
    option(parser, "name", "NAME", "name (in ./demos) or folder; default: the date and the time", nargs="?")
    option(parser, "--sensor", "SENSOR", "protocol (`pbd sensors` lists them), or sim[:TASK]; default: detect it")
    port = "the serial port, a phone's http:// address, or a gamepad's /dev/input/eventN"
    option(parser, "--port", "P", f"{port}; default: the only one plugged in")
    option(parser, "--baud", "B", "baud rate; default: try the sensor's usual rates", type=int)
    option(parser, "--rate", "HZ", "first set the device's rate, where it can be set", type=positive)
    option(parser, "--duration", "S", "end after this many seconds", type=positive)
    pause = "say 'pause now' when a move is more uncertain than this (1)"
    option(parser, "--tolerance", "CM", pause, type=positive, default=1.0)
    taps = "what marks the grip: space, or also two quick taps on the sensor's back"
    option(parser, "--grip", None, taps, choices=("space", "tap"), default="space")
    flag(parser, "--closed", "the hand will end where it began; tracking uses that")
    take = "record take N of a task, for `pbd fuse`, to ./demos/NAMEN, and say how to hold the sensor"
    option(parser, "--take", "N", take, type=integer("a whole number from 1 to 99", range(1, 100)))
    flag(parser, "--raw", "also keep the sensor's raw bytes (raw.bin)")
    flag(parser, "--reconnect", "wait for a sensor that was unplugged")
    option(
        parser, "--calibration", "C", "calibration of this sensor, to track with; warns if the sensor at rest disagrees"
    )
    flag(
        parser,
        "--force",
        "replace a demonstration of that name. The old one stays in NAME.before; if simulated and unedited, until the "
        "new one has ended with two stops or more",
    )
    flag(parser, "--live", "show the hand in the browser, served on this machine only")
    flag(parser, "--no-open", "with --live: open no browser; print the address")
    unit = "unit of acc, gyr, mag, angle or t, such as acc=g"
    option(add_line_options(parser), "--unit", "Q=U", unit, type=pair, action=AppendOnce, default=[])
    flag(parser, "--json", JSON)


def simulate(parser: ArgumentParser) -> None:
    """Make a synthetic demonstration with ground truth.

    Simulate a hand that holds a sensor and does a task; the ground truth is stored too.

      pbd simulate pour tea --sensor-model wt901 --seed 3
      pbd simulate touch trial-touch   to try `pbd calibrate points` with
    """
    task = "pour, pick-and-place-stops or pick-and-place-direct; to calibrate from: touch, pivot or sides"
    option(parser, "task", "TASK", task)
    option(parser, "name", "NAME", "the new demonstration's name (in ./demos) or folder")
    option(
        parser, "--sensor-model", "M", "os5000, os5000-nogyro, wt901, modern, phone or ideal (modern)", default="modern"
    )
    seed = integer("zero or a whole number above", range(sys.maxsize))
    another = "random seed of the sensor's errors and noise (0): another seed, another device"
    option(parser, "--seed", "N", another, type=seed, default=0)
    option(parser, "--rate", "HZ", "sample rate (the sensor model's own)", type=positive)
    flag(parser, "--force", REPLACE_DEMO)
    flag(parser, "--json", JSON)


def import_(parser: ArgumentParser) -> None:
    """Import a recording of another program.

    Read a recording (a table with a header, a ROS bag, a phone's zip, an x-IMU3's folder, a sketch's lines,
    an npz, a raw.bin of `pbd record --raw`; docs/imports.md has the programs) and store it as a demonstration.
    Names and units come from the header where it gives them; otherwise use --column and --unit. What was
    understood is printed. A level sensor must read +1 g on z: where it reads -1 g, flip the signs with
    --unit acc=-g.

      pbd import run7.csv tea --column ax=AccX --column ay=AccY --column az=AccZ --unit acc=g --unit t=ms
      pbd import log.txt tea2                    as WitMotion's program wrote it
      pbd import demos/tea/raw.bin again --sensor witmotion
    """
    option(parser, "file", "FILE", "the recording", type=Path)
    option(parser, "name", "NAME", "the new demonstration's name (in ./demos) or folder")
    column = (
        "t, gx, gy, gz, ax, ay, az, mx, my, mz, heading, pitch, roll, dt (time since the row before) or grip (1 is "
        "closed), and the file's name for it; -NAME flips its sign, or means that 1 is open"
    )
    option(parser, "--column", "OURS=THEIRS", column, type=pair, action=AppendOnce, default=[])
    unit = "unit of t, gyr, acc, mag or angle, such as t=ms, gyr=deg/s, acc=g; -UNIT flips the signs"
    option(parser, "--unit", "WHAT=UNIT", unit, type=pair, action=AppendOnce, default=[])
    sensor = (
        "the sensor that recorded it, as `pbd record` names it, such as witmotion: tracking then expects its usual "
        "errors, and its calibration knows it; of a raw.bin, its protocol"
    )
    option(parser, "--sensor", "SENSOR", sensor)
    option(parser, "--rate", "HZ", "sample rate of a raw.bin, or of a table without right times", type=positive)
    option(parser, "--grip", None, "find the grips that two quick taps on the sensor's back marked", choices=("tap",))
    option(parser, "--topic", "TOPIC", "topic of a bag's sensor_msgs/Imu messages; default: the only one")
    flag(parser, "--closed", "the hand ended where it began")
    flag(parser, "--force", REPLACE_DEMO)
    add_line_options(parser)
    flag(parser, "--json", JSON)


def demos(parser: ArgumentParser) -> None:
    """List the demonstrations that pbd knows.

    List the demonstrations in ./demos, the newest first, and the bundled ones: when and with which sensor each was
    recorded, how long it lasts, and whether its keyframes were edited.

      pbd demos
    """
    add_table(parser, units="s")


def sensors(parser: ArgumentParser) -> None:
    """Which sensors are plugged in, and which are supported.

    List the serial ports with something plugged in, and the sensors that pbd supports. As CSV these are
    two tables, with an empty line between. `pbd sensors phyphox` writes the experiment that a phone's app
    phyphox needs, and shows it as QR codes for the app to scan (docs/phones.md).

      pbd sensors --probe
      pbd sensors phyphox
    """
    option(parser, "phone", None, "prepare a phone with this app", nargs="?", choices=("phyphox",))
    output = "with phyphox: the experiment's file (pbd.phyphox), or a picture of its code (.png, .svg)"
    option(parser, "-o --output", "FILE", output, type=Path)
    flag(parser, "--probe", "listen to each port and detect its sensor")
    option(parser, "--port", "P", "with --probe: this port only")
    add_table(parser)
