"""pbd fuse TAKE... -o NAME: make one demonstration of several takes."""

import argparse
from dataclasses import replace

from pbd.cli.common import named_calibration, print_result, say_if_hiding_bundled, without_aside, write_figures
from pbd.cli.console import say, working
from pbd.errors import UsageError, amount, listed
from pbd.files.calibration_edit import (
    calibration_file,
    calibration_to_update,
    sensor_parts,
    update_calibration,
    warn_of_nav,
)
from pbd.files.demo import (
    demo_folder,
    load_demo,
    refuse_demo_folder,
    refuse_unwritable_fused,
    shell_word,
    write_demo,
)
from pbd.files.keyframes import KEYFRAMES_FILE
from pbd.fusion.fused_calibration import device_errors
from pbd.fusion.tables import fusion_rows, fusion_table, held_alike, takes_table
from pbd.io.toml import utc_now
from pbd.pipeline import fused_demo, track
from pbd.view.terminal_tables import print_table


def run(args: argparse.Namespace) -> None:
    """Fuse the takes, write the demonstration, and print which keyframes were matched."""
    folder = demo_folder(args.output)
    file = calibration_file(args.save_calibration) if args.save_calibration else None
    for output in filter(None, (args.plot, file)):
        if folder.resolve() in (output.resolve(), *output.resolve().parents):
            raise UsageError(f"{output} is in {folder}, which is written as a whole; give another place")
    with working("reading the takes"):
        takes = [load_demo(name) for name in without_aside(args.takes)]
    if len(takes) == 1 and not takes[0].takes:
        raise UsageError("name two takes or more; one alone is a demonstration already")
    demo = fused_demo(takes)
    refuse_unwritable_fused(demo, folder)
    refuse_demo_folder(folder, args.force)
    info = replace(demo.recording.info, name=folder.name, created=utc_now())
    demo = replace(demo, recording=replace(demo.recording, info=info))
    calibration = named_calibration(args)
    with working(f"fusing {len(demo.takes)} takes"):
        path = track(demo, calibration=calibration, accept_gap=args.accept_gap)
    fusion = path.fusion
    assert fusion is not None
    files = []
    if args.plot is not None:
        from pbd.plots.compare_figures import FUSION_FIGURES

        files = write_figures(args.plot, "png", FUSION_FIGURES, lambda name: FUSION_FIGURES[name](fusion))
    saved = {}
    if file is not None:
        errors, figures = device_errors(path)
        warn_of_nav(file, calibration_to_update(args.save_calibration)[1])
        update_calibration(file, sensor_parts(errors, figures))
        saved = {"calibration": str(file)}
        say(f"{file}: [sensor] of '{errors.sensor}' from {amount(int(figures['takes']), 'take')}")
    write_demo(demo, folder, force=args.force)
    keyframes, used = amount(len(path.stops), "keyframe"), sum(not take.left_out for take in fusion.takes)
    takes_used = f"{len(demo.takes)} takes" if used == len(demo.takes) else f"{used} of {len(demo.takes)} takes"
    say(f"wrote {folder}: {takes_used}, {keyframes}; it is a demonstration like any other")
    say_if_hiding_bundled(folder)
    if edited := [take.recording.info.name for take in demo.takes if take.keyframes is not None]:
        say(f"fused as recorded: {listed(edited)}, without {KEYFRAMES_FILE}; correct the fused keyframes instead")
    if held_alike(fusion.takes):
        say(
            "the sensor was held alike in all takes, so fusing can't remove its own errors; turn it by a quarter "
            "in the hand between takes, once about a level axis (`pbd record --take N` says how)"
        )
    if thing := fusion.thing:
        far = ", ".join(f"{100.0 * by:.0f} cm in {name}" for name, by in thing.moved_m.items())
        members = f"{thing.first}..{thing.last}"
        say(
            f"keyframes {members} move together against the others, as with a thing that stood elsewhere ({far}); if "
            f"so: pbd keyframes {shell_word(folder)} --frame NAME={members}"
        )
    if not (args.json or args.csv):
        print_table(takes_table(fusion, args.units))
        print()
    result = {"demo": folder.name, "folder": str(folder), "files": files} | saved | fusion_rows(path)
    print_result(args, result, fusion_table(path, args.units))
