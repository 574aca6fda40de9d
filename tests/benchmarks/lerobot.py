"""LeRobot's own loader, and its replay on emulated servos, on a dataset that `pbd export --format lerobot` wrote.

    pip install torch lerobot==0.4.4 feetech-servo-sdk
    python -m tests.benchmarks.lerobot FOLDER [--json]

LeRobot needs torch, so this is no test of the suite; without it, it says so and is no failure. FOLDER is the dataset;
pbd itself is not used, so that LeRobot may live in an environment of its own. With --port P --calibration F (of an arm,
or of `python -m tests.driving.emulator so101`) the first episode is replayed there by lerobot-replay's own function.
"""

import argparse
import json
import sys
import time
from importlib import metadata
from pathlib import Path
from typing import Any


def load(folder: Path) -> dict[str, Any]:
    """Load all frames, with windows in time, as training does; compare each episode with the file's rows."""
    import numpy as np
    import torch
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    windows = {"action": [i / 30.0 for i in range(-1, 9)], "observation.state": [0.0]}
    dataset = LeRobotDataset("pbd/export", root=folder, delta_timestamps=windows)
    frames = 0
    for batch in torch.utils.data.DataLoader(dataset, batch_size=64):
        frames += len(batch["index"])
        assert batch["action"].shape[1:] == (10, len(dataset.features["action"]["names"]))
        assert torch.isfinite(batch["action"]).all()
        inside = ~batch["action_is_pad"][:, 0]
        assert torch.equal(batch["observation.state"][inside, 0], batch["action"][inside, 0])  # a frame behind
    lengths = []
    for i in range(dataset.num_episodes):
        episode = LeRobotDataset("pbd/export", root=folder, episodes=[i])
        lengths.append(len(episode))
        assert isinstance(episode[0]["task"], str)
    assert frames == sum(lengths) == dataset.num_frames
    mean = np.stack([np.asarray(row["action"]) for row in dataset.hf_dataset]).mean(axis=0)
    assert np.allclose(mean, dataset.meta.stats["action"]["mean"], atol=1e-3)
    return {"robot_type": dataset.meta.robot_type, "episodes": len(lengths), "frames": frames}


def replay(folder: Path, robot_type: str, port: str, calibration: Path) -> dict[str, Any]:
    """Replay the first episode by LeRobot's function; say how far the arm was behind its goals."""
    import numpy as np
    from lerobot.robots.so_follower import SOFollower, SOFollowerRobotConfig
    from lerobot.scripts.lerobot_replay import DatasetReplayConfig, ReplayConfig
    from lerobot.scripts.lerobot_replay import replay as lerobot_replay

    sent, read = [], []
    send, observe = SOFollower.send_action, SOFollower.get_observation

    def send_and_keep(self: Any, action: dict[str, float]) -> Any:
        sent.append([float(x) for x in action.values()])
        return send(self, action)

    def observe_and_keep(self: Any) -> Any:
        found = observe(self)
        read.append([float(found[name]) for name in found])
        return found

    SOFollower.send_action, SOFollower.get_observation = send_and_keep, observe_and_keep
    config = SOFollowerRobotConfig(port=port, use_degrees=True, id=calibration.stem, calibration_dir=calibration.parent)
    config.type  # noqa: B018 (draccus looks it up)
    dataset = DatasetReplayConfig(repo_id="pbd/export", episode=0, root=folder)
    began = time.monotonic()
    lerobot_replay.__wrapped__(ReplayConfig(robot=config, dataset=dataset, play_sounds=False))
    off = np.abs(np.array(read[1:]) - np.array(sent[:-1]))
    seconds = time.monotonic() - began
    return {
        "robot": robot_type,
        "seconds": seconds,
        "frames": len(sent),
        "behind_deg": off[:, :-1].max(axis=0).tolist(),
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--port")
    parser.add_argument("--calibration", type=Path)
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    try:
        version = metadata.version("lerobot")
    except metadata.PackageNotFoundError:
        print("lerobot is not installed: nothing was checked")
        return 0
    found = {"lerobot": version, **load(args.folder)}
    if args.port:
        found["replay"] = replay(args.folder, found["robot_type"], args.port, args.calibration)
    print(json.dumps(found) if args.json else "\n".join(f"{key}: {value}" for key, value in found.items()))
    return 0


if __name__ == "__main__":
    sys.exit(main())
