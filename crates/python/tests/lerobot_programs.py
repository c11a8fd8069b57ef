"""LeRobot's programs with a running teleopd: a person is recorded, the recording leads the simulated robot, and a person is watched.

    python3 lerobot_programs.py FOLDER REPLAY
"""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq

import teleopd
from teleopd import client

folder, programs = Path(sys.argv[1]), Path(sys.argv[2]).parent
clients = Path("tools/clients/lerobot").resolve()
subprocess.run([sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", clients / "robot", clients / "teleoperator"], check=True)
run_dir, data, RECORDED_S = folder / "run", folder / "recorded", 6
started = []


def start(*words):
    started.append(subprocess.Popen(list(map(str, words)), stdout=subprocess.DEVNULL))
    return started[-1]


def end(*processes):
    for process in processes:
        process.send_signal(signal.SIGINT)
    return [process.wait(30) for process in processes]


def lerobot(program, *options):
    # Nothing is looked up or stored elsewhere.
    environment = os.environ | {"HF_HUB_OFFLINE": "1", "HF_LEROBOT_HOME": str(folder / "home"), "PYTHONPATH": os.environ["PYTHONPATH"]}
    words = [Path(sys.executable).parent / program, "--robot.type=teleopd", f"--robot.run_dir={run_dir}", *options]
    process = subprocess.Popen(list(map(str, words)), env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    started.append(process)
    return process


def joints(until, within_s=60.0):
    """The first joints for which `until` holds."""
    give_up = time.monotonic() + within_s
    while time.monotonic() < give_up:
        try:
            with client.JointsReader(run_dir) as reader:
                while time.monotonic() < give_up:
                    newest = reader.latest()
                    if newest is not None and until(newest):
                        return newest
                    time.sleep(0.01)
        except (client.TeleopdError, OSError):
            time.sleep(0.5)
    raise AssertionError("the robot does not do what is waited for")


def engaged(sources):
    """Engages as soon as somebody can lead. Returns the operator's process."""
    give_up = time.monotonic() + 120.0
    while time.monotonic() < give_up:
        operator = start(programs / "teleopctl", "engage", "--run-dir", run_dir)
        while operator.poll() is None and time.monotonic() < give_up:
            if joints(lambda newest: True).sources == sources:
                return operator
            time.sleep(0.2)
        time.sleep(1.0)
    raise AssertionError("the robot is not engaged")


def ended(process, within_s=180.0):
    text, _ = process.communicate(timeout=within_s)
    assert process.returncode == 0, text
    return text


teleoperator = ["--teleop.type=teleopd", f"--teleop.run_dir={run_dir}"]
try:
    up = start(programs / "teleopd", "up", "--run-dir", run_dir, "--engage-without-realtime")
    joints(lambda newest: True)
    person = start(programs / "replay", "builtin", "--loop", "--run-dir", run_dir)
    engage = engaged(sources=3)
    ended(lerobot(
        "lerobot-record", *teleoperator, "--dataset.repo_id=local/recorded", f"--dataset.root={data}", "--dataset.single_task=follow",
        "--dataset.num_episodes=1", f"--dataset.episode_time_s={RECORDED_S}", "--dataset.reset_time_s=0", "--dataset.push_to_hub=false",
        "--dataset.video=false", "--dataset.no_stamp=true", "--dataset.fps=30", "--play_sounds=false",
    ))
    ended(lerobot("lerobot-teleoperate", *teleoperator, "--fps=30", "--teleop_time_s=2"))
    assert set(end(engage, person)) <= {0, 130}

    names = json.loads((data / "meta/info.json").read_text())["features"]["action"]["names"]
    table = pq.read_table(data / "data/chunk-000/file-000.parquet")
    action, state = (np.stack(table[name].to_numpy()) for name in ("action", "observation.state"))
    assert names == [f"{joint}.pos" for joint in teleopd.Robot("tiago_dual").joint_names] and len(table) > 20 * RECORDED_S
    assert np.ptp(action, axis=0).max() > 0.1 and np.abs(action - state).max() < 0.5

    # Its own actions lead the robot again.
    again = lerobot("lerobot-replay", "--robot.leads=true", "--dataset.repo_id=local/recorded", f"--dataset.root={data}", "--dataset.episode=0",
                    "--play_sounds=false")
    engage = engaged(sources=12)
    seen = []
    with client.JointsReader(run_dir) as reader:
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
    # As Ctrl-C ends a program.
    assert end(up) == [130]
finally:
    for process in started:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
            process.wait(30)
