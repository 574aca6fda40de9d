"""How long the line takes on the bundled demonstration: python tests/benchmarks/pipeline.py [--json] [--quick].

help_s: `pbd --help` as a whole process. plan_ms: from the recording to an audited trajectory, imports and files done.
stages_ms: its parts (collision: one check of the whole motion; audit: its own beside all else; audit_load: what that
loads before, caches on disk warm); page: the replay page
with meshes cached. Medians.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

import pbd
from pbd.arm.model import load_model
from pbd.audit.arm import AuditArm
from pbd.audit.audit import audit
from pbd.audit.collision_pairs import AuditScene
from pbd.planning import plan_keyframes, scene_of
from pbd.replay import replay_scene
from pbd.tracking.keyframes import find_keyframes
from pbd.view.page import write_page
from tests.arm.collision_oracles import first_hit
from tests.arm.straight_moves import solve_path, time_keyframes
from tests.benchmarks.report import arguments, finish, median_ms


def main() -> None:
    """Measure and print."""
    args = arguments(str(__doc__)).parse_args()
    runs = 5 if args.quick else 31

    demo, robot = pbd.load_demo("pouring"), pbd.load_robot("panda")
    calibration = robot.dock or pbd.load_calibration("default")
    path = pbd.track(demo.recording)
    keyframes = find_keyframes(path)
    plan = plan_keyframes(keyframes, calibration, robot, None, path, demo.grasped)
    arm, world = load_model(robot), (calibration, demo.grasped)
    scene = scene_of(arm, *world)
    T_base_tool, q = plan.T_base_tool, plan.trajectory.keyframe_q
    grips = [keyframe.grip for keyframe in keyframes]
    dwells = [0.5] * len(keyframes)

    def whole() -> None:
        path = pbd.track(demo.recording)
        plan_keyframes(find_keyframes(path), calibration, robot, None, path, demo.grasped)

    with tempfile.TemporaryDirectory() as folder:
        page = Path(folder) / "page.html"
        shown = replay_scene(plan)
        stages = {
            "track": median_ms(lambda: pbd.track(demo.recording), runs),
            "model": median_ms(lambda: load_model(robot), runs),
            "ik": median_ms(lambda: solve_path(arm, T_base_tool, robot.home), runs),
            "timing": median_ms(lambda: time_keyframes(arm, q, dwells, grips, robot.home), runs),
            "collision": median_ms(lambda: first_hit(scene, plan.trajectory), runs),
            "audit": median_ms(lambda: audit(plan.trajectory, robot, T_base_tool, world), runs),
            "audit_load": median_ms(lambda: AuditScene(AuditArm(robot), *world), runs),
            "page": median_ms(lambda: write_page(shown, page), max(3, runs // 10)),
        }
    command = [sys.executable, "-m", "pbd", "--help"]
    finish(
        {
            "help_s": median_ms(lambda: subprocess.run(command, capture_output=True, check=True), runs) / 1e3,
            "plan_ms": median_ms(whole, runs),
            "stages_ms": stages,
        },
        args.json,
    )


if __name__ == "__main__":
    main()
