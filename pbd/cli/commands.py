"""All commands with their options. A command's module is imported when it runs, so that `pbd --help` is instant."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from pbd import __version__
from pbd.cli.calibrate import add_calibrate
from pbd.cli.completion import SHELLS, PrintCompletion
from pbd.cli.many import add_check, add_fuse, add_plot
from pbd.cli.options import (
    Commands,
    Parser,
    add_accept_gap,
    add_command,
    add_demo,
    add_force,
    add_json,
    add_lines,
    add_planning,
    add_table,
    add_tracking,
    finite,
    frame,
    integer,
    pair,
    positive,
    take_number,
)
from pbd.cli.run import add_run
from pbd.errors import nearest
from pbd.files.exporters import FORMATS, HIGHEST_HZ, LOWEST_HZ, SUFFIXES

EPILOG = """\
a first look:
  pbd replay --robot panda              a panda replays the bundled demonstration
  pbd keyframes                         where the hand stopped, and how certain that is
  pbd export --robot panda --format csv -o pouring.csv

exit codes: 0 done; 1 the input, the output or the device is at fault; 2 wrong usage; 3 the robot can't do it
"""


def parser() -> argparse.ArgumentParser:
    """Build the parser of all commands."""
    top = Parser(
        prog="pbd",
        description="Show a robot arm a task with a small inertial sensor in your hand; the arm replays it.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    top.add_argument("--version", action="version", version=f"pbd {__version__}")
    completion = "print the script that completes commands, options and names in that shell"
    top.add_argument("--print-completion", action=PrintCompletion, choices=SHELLS, help=completion)
    commands = top.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for add in COMMANDS:
        add(commands)
    return top


def parse(argv: Sequence[str] | None) -> argparse.Namespace:
    """Parse a command; its own parser reports unexpected arguments."""
    top = parser()
    args, unknown = top.parse_known_args(argv)
    if unknown:
        command: argparse.ArgumentParser = getattr(args, "parser", top)
        word = unknown[0].partition("=")[0]
        if not word.startswith("-"):
            command.error(f"unexpected argument '{word}'")
        options = [option for action in command._actions for option in action.option_strings]
        command.error(f"unknown option {word}{nearest(word, options)}")
    return args


def _add_record(commands: Commands) -> None:
    parser = add_command(
        commands,
        "record",
        "record a demonstration from a sensor",
        "Record to ./demos/NAME, sample by sample. Hold still for two seconds, then move, stop, move, stop.\n"
        "At a terminal: Enter ends the recording, space marks that the grip closes or opens, q discards it\n"
        "(after a question), Ctrl-C ends and keeps it as Enter does.\n"
        "`--sensor sim` simulates a hand that does a TASK (pour) and grips by itself.",
        "  pbd record tea --sensor witmotion\n"
        "  pbd record tea --sensor sim:pour           without hardware: a simulated hand that pours\n"
        "  pbd record tea --sensor phyphox --port http://192.168.1.20:8080 --grip tap       from a phone\n"
        "  pbd record tea --sensor gamepad            a DualSense or DualShock 4; its buttons mark the grip\n"
        "  pbd record tea --live                      and see the hand, its path and its stops in the browser\n"
        '  pbd record tea --sensor lines --columns "t,ax,ay,az,gx,gy,gz" --unit t=ms --unit acc=g --unit gyr=deg/s',
    )
    option = parser.add_argument
    option("name", nargs="?", metavar="NAME", help="name in ./demos; default: the date and the time")
    sensor = "protocol (`pbd sensors` lists them), or sim[:TASK]; default: detect it"
    option("--sensor", metavar="SENSOR", help=sensor)
    port = (
        "the serial port, a phone's http:// address, or a gamepad's /dev/input/eventN; default: the only one plugged in"
    )
    option("--port", metavar="P", help=port)
    option("--baud", type=int, metavar="B", help="default: try the sensor's usual rates")
    option("--rate", type=positive, metavar="HZ", help="first set the device's rate, where it can be set")
    option("--duration", type=positive, metavar="S", help="end after this many seconds")
    tolerance = "uncertainty of a move that calls 'pause now' (1)"
    option("--tolerance", type=positive, default=1.0, metavar="CM", help=tolerance)
    taps = "what marks the grip: space alone, or two quick taps on the sensor's back too"
    option("--grip", choices=("space", "tap"), default="space", help=taps)
    option("--closed", action="store_true", help="the hand will end where it began; tracking uses that")
    take = "of several takes of one task (`pbd fuse`), the one to record: to ./demos/NAMEN, and how to hold the sensor"
    option("--take", type=take_number, metavar="N", help=take)
    option("--raw", action="store_true", help="also keep the sensor's raw bytes (raw.bin)")
    option("--reconnect", action="store_true", help="wait for a sensor that was unplugged")
    option("--calibration", metavar="C", help="of this sensor: used to track, and compared with the sensor at rest")
    add_force(
        parser,
        "replace a demonstration of that name: the old one is in NAME.before until the new one has ended well, "
        "with two stops or more",
    )
    option("--live", action="store_true", help="show the hand in the browser, served on this machine only")
    option("--no-open", action="store_true", help="with --live: open no browser; print the address")
    unit = "unit of acc, gyr, mag, angle or t, such as acc=g"
    add_lines(parser).add_argument("--unit", action="append", default=[], metavar="Q=U", help=unit)
    add_json(parser)


def _add_simulate(commands: Commands) -> None:
    parser = add_command(
        commands,
        "simulate",
        "make a synthetic demonstration with ground truth",
        "Simulate a hand that holds a sensor and does a task; the ground truth is stored too.",
        "  pbd simulate pour tea --sensor-model wt901 --seed 3\n"
        "  pbd simulate touch trial-touch   to try `pbd calibrate points` with",
    )
    option = parser.add_argument
    task = "pour, pick-and-place-stops or pick-and-place-direct; to calibrate from: touch, pivot or sides"
    option("task", metavar="TASK", help=task)
    option("name", metavar="NAME", help="the new demonstration's name (in ./demos) or folder")
    models = "os5000, os5000-nogyro, wt901, modern, phone or ideal (modern)"
    option("--sensor-model", default="modern", metavar="M", help=models)
    option("--seed", type=int, default=0, metavar="N", help="random seed of the sensor's errors and noise (0)")
    option("--rate", type=positive, metavar="HZ", help="sample rate (the sensor model's own)")
    add_force(parser)
    add_json(parser)


def _add_import(commands: Commands) -> None:
    parser = add_command(
        commands,
        "import",
        "import a recording of another program",
        "Read a recording (a table with a header, a ROS 2 bag, a phone's zip, an x-IMU3's folder, a sketch's lines,\n"
        "an npz, a raw.bin of `pbd record --raw`; docs/imports.md has the programs) and store it as a demonstration.\n"
        "Names and units come from the header where it gives them; otherwise use --column and --unit. What was\n"
        "understood is printed. A level sensor must read +1 g on z: where it reads -1 g, turn the signs with\n"
        "--unit acc=-g.",
        "  pbd import run7.csv tea --column ax=AccX --column ay=AccY --column az=AccZ --unit acc=g --unit t=ms\n"
        "  pbd import log.txt tea2                    as WitMotion's program wrote it\n"
        "  pbd import demos/tea/raw.bin again --sensor witmotion",
    )
    option = parser.add_argument
    option("file", metavar="FILE", type=Path, help="the recording")
    option("name", metavar="NAME", help="the new demonstration's name (in ./demos) or folder")
    column = (
        "t, gx, gy, gz, ax, ay, az, mx, my, mz, heading, pitch or roll, and the file's name for it; -NAME turns its"
    )
    option("--column", type=pair, action="append", default=[], metavar="OURS=THEIRS", help=f"{column} sign")
    unit = "of t, gyr, acc, mag or angle, such as t=ms, gyr=deg/s, acc=g; -UNIT turns the signs"
    option("--unit", type=pair, action="append", default=[], metavar="WHAT=UNIT", help=unit)
    option("--sensor", metavar="SENSOR", help="the sensor that recorded it; needed for a raw.bin")
    option("--rate", type=positive, metavar="HZ", help="sample rate of a raw.bin, or of a table without times")
    option("--grip", choices=("tap",), help="find the grips that two quick taps on the sensor's back marked")
    option("--topic", metavar="TOPIC", help="of a bag: its sensor_msgs/Imu; default: the only one")
    option("--closed", action="store_true", help="the hand ended where it began")
    add_force(parser)
    add_lines(parser)
    add_json(parser)


def _add_segments(commands: Commands) -> None:
    parser = add_command(
        commands,
        "segments",
        "when the hand moved, when it rested, and what kind of motion it was",
        "Print the paper's Table I for a demonstration: the intervals of samples, what happens in each, and how long.",
        "  pbd segments paper-test1",
    )
    add_demo(parser)
    add_table(parser, units="ms")
    add_tracking(parser, calibration="none")


def _add_keyframes(commands: Commands) -> None:
    parser = add_command(
        commands,
        "keyframes",
        "where the hand stopped, and how certain that is",
        "Print the pose at each stop of a demonstration with its uncertainty; with a robot also the tool's pose\n"
        "in the robot's base and the joints that reach it. --save writes them for you to edit.",
        "  pbd keyframes pouring --robot panda\n  pbd keyframes tea --save",
    )
    add_demo(parser)
    add_table(parser, units="m,deg,s")
    save = "write keyframes.toml into the demonstration, for you to edit"
    parser.add_argument("--save", action="store_true", help=save)
    add_force(parser, "with --save: find the keyframes again, and replace the file")
    belongs = (
        "these keyframes belong to a thing, which `pbd replay --at` moves: cup=3..5, or lid=6..7@cup: carried by it"
    )
    parser.add_argument("--frame", type=frame, action="append", default=[], metavar="THING=I..J", help=belongs)
    within = "how likely the tool is so near to where it belongs, and turned by no more (the keyframes' own tolerances)"
    parser.add_argument("--tolerance", type=finite, nargs="+", metavar=("METRES", "DEGREES"), help=within)
    add_tracking(parser, calibration="with --robot its own dock, else 'default'; without, none")
    add_planning(parser, robot_required=False, units=False)


def _add_touch(commands: Commands) -> None:
    parser = add_command(
        commands,
        "touch",
        "correct a keyframe where the arm was tried and was off",
        "The tool is off at a keyframe: say by how much, or where it belongs. That is a measurement, so the other\n"
        "keyframes move with it as far as their errors have something in common. It is kept in keyframes.toml.",
        "  pbd touch tea 3 --robot panda --by 0 -0.004 0\n  pbd touch tea --robot panda --undo",
    )
    option = parser.add_argument
    option("demo", metavar="DEMO", help="a demonstration's name (in ./demos), or its folder")
    option("keyframe", nargs="?", type=integer, metavar="KEYFRAME", help="its number, as `pbd keyframes` has it")
    option("--robot", required=True, metavar="R", help="the arm that was tried")
    option("--by", type=finite, nargs=3, metavar=("X", "Y", "Z"), help="how far the tool is to go, m, in base axes")
    option("--tool", action="store_true", help="with --by: in the tool's own axes")
    option("--at", type=finite, nargs=3, metavar=("X", "Y", "Z"), help="where the tool belongs in base, m")
    option("--only", action="store_true", help="the other keyframes stay where they are")
    option("--undo", action="store_true", help="take the last touch-up back; it stays in the file as undone")
    wanted = "name (in ./calibration, or bundled) or file; default: the robot's own dock, else 'default'"
    option("--calibration", metavar="C", help=wanted)
    add_accept_gap(parser)
    add_table(parser, units="m")
    parser.set_defaults(time="limits", dwell=None, force=False)


def _add_replay(commands: Commands) -> None:
    parser = add_command(
        commands,
        "replay",
        "plan the robot's motion, audit it and show it",
        "Plan the motion of a robot through a demonstration's keyframes, audit it against all limits, and show it:\n"
        "in the browser, served on this machine only, or as one HTML file that plays anywhere without a network.",
        "  pbd replay pouring --robot panda --html pouring.html",
    )
    add_demo(parser)
    add_json(parser)
    parser.add_argument("--html", type=Path, metavar="FILE", help="write the page to FILE instead of serving it")
    parser.add_argument("--no-open", action="store_true", help="do not open a browser; print the address")
    add_tracking(parser)
    add_planning(parser)


def _add_export(commands: Commands) -> None:
    parser = add_command(
        commands,
        "export",
        "write the joint trajectory for other tools",
        "Plan and audit as `pbd replay` does, and write the joint trajectory.",
        "  pbd export pouring --robot panda -o pouring.json\n"
        "  pbd export pouring --robot panda --format csv -o - | head -3\n"
        "  pbd export tea1 tea2 --robot so101 --format lerobot --task 'pour the tea' -o tea",
    )
    option = parser.add_argument
    demos = "names (in ./demos, or bundled), folders, or recordings; default: the newest in ./demos, else 'pouring'; "
    option("demos", nargs="*", metavar="DEMO", help=f"{demos}lerobot alone takes several")
    add_json(parser)
    form = f"{', '.join(FORMATS)}; default: from FILE's ending ({', '.join(SUFFIXES)})"
    option("--format", choices=tuple(FORMATS), help=form)
    output = "the file to write (lerobot: the folder); - is standard output"
    option("-o", "--output", required=True, type=Path, metavar="FILE", help=output)
    rate = "samples a second, from 10 to 100000 (1000; tum: 100; glb: 50; ros2-json: none but the motion's own knots)"
    option("--rate", type=_export_rate, metavar="HZ", help=rate)
    dense = (
        "urscript: servoj at the controller's period (--rate 125, or 500 for e-Series), not a movej for each keyframe"
    )
    option("--dense", action="store_true", help=dense)
    option("--task", default="", metavar="WORDS", help="lerobot: what the arm does, in words; default: DEMO's name")
    add_tracking(parser)
    add_planning(parser)


def _export_rate(text: str) -> float:
    rate = positive(text)
    if not LOWEST_HZ <= rate <= HIGHEST_HZ:
        raise argparse.ArgumentTypeError(f"must be {LOWEST_HZ:g} to {HIGHEST_HZ:g} Hz, got {text}")
    return rate


def _add_robots(commands: Commands) -> None:
    parser = add_command(
        commands,
        "robots",
        "list the robots that pbd knows",
        "List the robots in ./robots and the bundled ones, with their reach (tool from the base's axis) and what pbd\n"
        "assumes about them; or show one, with the links that are not checked for collisions. To add your own, put a\n"
        "file into ./robots (docs/robots.md).",
        "  pbd robots panda\n  pbd robots --for pouring\n  pbd robots --suggest robots/mine.toml",
    )
    parser.add_argument("robot", nargs="?", metavar="R", help="a robot's name or file; default: all")
    able = "which robots can replay this demonstration on their own docks, fastest first; what stops the others"
    parser.add_argument("--for", dest="demo", metavar="DEMO", help=able)
    missing = "find a home and a dock for a robot's TOML that lacks them, with which it replays --for (pouring)"
    parser.add_argument("--suggest", type=Path, metavar="FILE", help=missing)
    add_table(parser, units="m")


def _add_sensors(commands: Commands) -> None:
    parser = add_command(
        commands,
        "sensors",
        "which sensors are plugged in, and which are supported",
        "List the serial ports with something plugged in, and the sensors that pbd supports. As CSV these are\n"
        "two tables, with an empty line between. `pbd sensors phyphox` writes the experiment that a phone's app\n"
        "phyphox needs, and shows it as QR codes for the app to scan (docs/phones.md).",
        "  pbd sensors --probe\n  pbd sensors phyphox",
    )
    parser.add_argument("phone", nargs="?", choices=("phyphox",), help="prepare a phone with this app")
    output = "with phyphox: the experiment's file (pbd.phyphox), or a picture of its code (.png, .svg)"
    parser.add_argument("-o", "--output", type=Path, metavar="FILE", help=output)
    parser.add_argument("--probe", action="store_true", help="listen to each port and detect its sensor")
    parser.add_argument("--port", metavar="P", help="this port only")
    add_table(parser)


COMMANDS = (
    *(_add_record, _add_simulate, _add_import, _add_segments, _add_keyframes, _add_touch, add_plot, add_fuse),
    *(add_check, add_calibrate, _add_replay, _add_export, add_run, _add_robots, _add_sensors),
)
