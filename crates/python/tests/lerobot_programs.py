"""LeRobot's programs with a running teleopd: a person is recorded, the recording leads the simulated robot, and a person is watched.

    python3 lerobot_programs.py FOLDER REPLAY
"""

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq

import teleopd
from rig import INTERRUPTED, Rig, end
from teleopd import client

folder, programs = Path(sys.argv[1]), Path(sys.argv[2]).parent
clients = Path("tools/clients/lerobot").resolve()
subprocess.run([sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", clients / "robot", clients / "teleoperator"], check=True)
data, RECORDED_S = folder / "recorded", 6


def lerobot(rig, program, *options):
    # Nothing is looked up or stored elsewhere.
    environment = os.environ | {"HF_HUB_OFFLINE": "1", "HF_LEROBOT_HOME": str(folder / "home"), "PYTHONPATH": os.environ["PYTHONPATH"]}
    words = [Path(sys.executable).parent / program, "--robot.type=teleopd", f"--robot.run_dir={rig.run_dir}", *options]
    return rig.keep(subprocess.Popen(list(map(str, words)), env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True))


def ended(process, within_s=180.0):
    text, _ = process.communicate(timeout=within_s)
    assert process.returncode == 0, text
    return text


with Rig(folder, programs) as rig:
    teleoperator = ["--teleop.type=teleopd", f"--teleop.run_dir={rig.run_dir}"]
    person = rig.start("replay", "builtin", "--loop")
    engage = rig.engaged(sources=3)
    ended(lerobot(
        rig, "lerobot-record", *teleoperator, "--dataset.repo_id=local/recorded", f"--dataset.root={data}", "--dataset.single_task=follow",
        "--dataset.num_episodes=1", f"--dataset.episode_time_s={RECORDED_S}", "--dataset.reset_time_s=0", "--dataset.push_to_hub=false",
        "--dataset.video=false", "--dataset.no_stamp=true", "--dataset.fps=30", "--play_sounds=false",
    ))
    ended(lerobot(rig, "lerobot-teleoperate", *teleoperator, "--fps=30", "--teleop_time_s=2"))
    assert set(end(engage, person)) <= {0, INTERRUPTED}

    names = json.loads((data / "meta/info.json").read_text())["features"]["action"]["names"]
    table = pq.read_table(data / "data/chunk-000/file-000.parquet")
    action, state = (np.stack(table[name].to_numpy()) for name in ("action", "observation.state"))
    assert names == [f"{joint}.pos" for joint in teleopd.Robot("tiago_dual").joint_names] and len(table) > 20 * RECORDED_S
    assert np.ptp(action, axis=0).max() > 0.1 and np.abs(action - state).max() < 0.5

    # Its own actions lead the robot again.
    again = lerobot(rig, "lerobot-replay", "--robot.leads=true", "--dataset.repo_id=local/recorded", f"--dataset.root={data}", "--dataset.episode=0",
                    "--play_sounds=false")
    engage = rig.engaged(sources=12)
    seen = []
    with client.JointsReader(rig.run_dir) as reader:
        while again.poll() is None:
            newest = reader.latest()
            if newest is not None and newest.sources == 12:
                seen.append(newest.commanded[: len(names)])
            time.sleep(0.01)
    ended(again)
    end(engage)
    nearest = [np.abs(action - row).max(1).min() for row in seen[len(seen) // 2 :]]
    print(f"lerobot-record: {len(table)} frames; lerobot-replay led for {len(seen)} samples of the joints, "
          f"{np.degrees(np.median(nearest)):.1f} degrees beside a recorded row (median of the worst joint)")
    assert len(seen) > 50 and np.median(nearest) < np.radians(5.0)
    assert end(rig.up) == [INTERRUPTED]
