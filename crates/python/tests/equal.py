"""Compares the package with the program `replay`, bit for bit, and its errors with their promises.

    equal.py FOLDER REPLAY
"""

import os
import re
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import teleopd
from refusals import refused

folder, replay = Path(sys.argv[1]), sys.argv[2]
clip = folder / "in/clip.bvh"


def run(*arguments):
    subprocess.run([replay, *map(str, arguments)], check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


# Postures.
robot = teleopd.Robot("tiago_dual")
motion = teleopd.read_motion(clip)
run("batch", "--input", folder / "in", "--out", folder / "out", "--format", "npz")
batch = np.load(folder / "out/clip.npz")
retargeter = teleopd.Retargeter(robot)
q = retargeter.retarget(motion)
assert batch["joints"].tolist() == robot.joint_names
assert len(q) == len(motion) > 100 and np.array_equal(q, batch["q"])
assert np.array_equal(q, retargeter.retarget(motion.positions, motion.rotations, rate_hz=motion.rate_hz))
assert not np.array_equal(q, teleopd.Retargeter(robot, refinement_steps=0).retarget(motion))
run("batch", "--input", folder / "in", "--out", folder / "fast", "--format", "npz", "--rate", 240)
assert np.array_equal(retargeter.retarget(motion, out_hz=240), np.load(folder / "fast/clip.npz")["q"])

# The latent space: the refined postures begin at the decoded ones.
latents = retargeter.encode(motion)
decoded = retargeter.decode(latents)
assert np.array_equal(decoded, teleopd.Retargeter(robot, refinement_steps=0).retarget(motion))
assert np.array_equal(teleopd.interpolate(latents, latents[::-1], 0.0), latents)
assert np.allclose(teleopd.interpolate(latents, latents[::-1], 1.0), latents[::-1], atol=1e-6)

# Trajectories.
run(clip, "--offline", folder / "out.csv", "--calibration", "clip", "--record", folder / "out.mcap")
offline = np.loadtxt(folder / "out.csv", delimiter=",", skiprows=1)
every = teleopd.certify(motion, robot, rate_hz=1500)
count = len(robot.joint_names)
# The simulated body of `replay --offline` decides how long the robot still stands at the end.
same = min(len(every), len(offline))
assert max(len(every), len(offline)) - same < 200, (len(every), len(offline))
assert np.array_equal(every.time_s[:same], offline[:same, 0])
assert np.array_equal(every.positions[:same], offline[:same, 1 : count + 1])
assert np.array_equal(every.targets[:same], offline[:same, count + 1 :])
longer = every.positions if len(every) > same else offline[:, 1 : count + 1]
assert np.all(longer[same:] == longer[same - 1])
run("batch", "--certified", "--input", folder / "in", "--out", folder / "safe", "--format", "npz")
assert np.array_equal(every.positions, np.load(folder / "safe/clip.npz")["q"])
some = teleopd.certify(motion, robot)
for name in ("time_s", "positions", "velocities", "targets", "modes", "clearance_m", "torque_share", "frames"):
    assert np.array_equal(getattr(some, name), getattr(every, name)[::15]), name
assert np.all(np.abs(every.velocities) <= robot.limits["velocity"] * (1 + 1e-9))
assert np.allclose(np.diff(every.positions, axis=0) * 1500, every.velocities[1:], atol=2e-2)
assert 0 < every.torque_share.max() <= 1 and np.isclose(every.torque_share.max(), every.report["torque_share_max"], rtol=1e-6)
assert np.abs(every.clearance_m - robot.clearance(every.positions)).max() < 1e-9
assert every.frames[0] == -1 and every.frames.max() == len(motion) - 1 and np.all(np.diff(every.frames) >= 0)
assert {teleopd.MODES[mode] for mode in every.modes} >= {"Engaging", "Engaged"}
assert every.report["ticks"] == len(every) and not any(every.report["violations"].values())

# Recordings.
recording = teleopd.read_recording(folder / "out.mcap")
commands = recording.messages["commands"]
assert recording.lost is None and recording.about["robot"] == robot.name
assert np.array_equal(commands["positions"][-len(offline) :], offline[:, 1 : count + 1])
assert recording.messages["skeletons"]["positions"].shape[1:] == (22, 3)
fewer = teleopd.read_recording(folder / "out.mcap", rate_hz=50)
assert 25 < len(commands["k"]) / len(fewer.messages["commands"]["k"]) < 35

# The book's examples, beside the recording that they read.
book = Path(__file__).resolve().parents[3] / "docs/src/python.md"
blocks = [block for block in re.findall(r"```python\n(.*?)```", book.read_text(), re.S) if "mjcf" not in block]
assert len(blocks) == 3, len(blocks)
here = os.getcwd()
os.chdir(folder)
names = {}
for block in blocks:
    exec(compile(block, str(book), "exec"), names)
os.chdir(here)
assert names["q"].shape == (1314, 17) and names["between"].shape == (17,)

# Errors name shape, unit and bound.
refused(ValueError, ["positions", "(3, 21, 3)", "(N, 22, 3)", "m"], lambda: retargeter.retarget(np.zeros((3, 21, 3))))
refused(ValueError, ["positions[0, 4]", "within 1000 m"], lambda: teleopd.Motion(np.where(np.arange(22)[:, None] == 4, 1e5, 0) + np.zeros((22, 3))))
refused(ValueError, ["rotations[0, 0]", "unit quaternion"], lambda: teleopd.Motion(motion.positions, np.zeros((len(motion), 22, 4))))
refused(ValueError, ["rate_hz = 0", "Hz"], lambda: teleopd.Motion(motion.positions, rate_hz=0))
refused(ValueError, ["q", "(16,)", "(17)", "rad or m"], lambda: robot.forward(np.zeros(16)))
refused(ValueError, ["arm_left_1_joint", "finite"], lambda: robot.clearance(np.where(np.arange(17) == 3, np.nan, 0)))
refused(ValueError, ["rate_hz = 7", "divide 1500 Hz"], lambda: teleopd.certify(motion, robot, rate_hz=7))
refused(ValueError, ["none_such", "tiago_dual"], lambda: teleopd.Robot("none_such"))
refused(ValueError, ["refinement_steps = 999"], lambda: teleopd.Retargeter(robot, 999))
refused(ValueError, ["clip.bvh"], lambda: teleopd.read_recording(clip))
refused(OSError, ["none.bvh"], lambda: teleopd.read_motion(folder / "none.bvh"))
# They name arguments of Python, and no option of a command.
refused(ValueError, ["clip.bvh: up is for .npy, .npz files"], lambda: teleopd.read_motion(clip, up="z"))
refused(ValueError, ["give the true one: frame_rate_hz"], lambda: teleopd.read_motion(clip, frame_rate_hz=0))
refused(OSError, ["none.toml"], lambda: teleopd.read_motion(clip, map=folder / "none.toml"))
lying = teleopd.Motion(motion.positions[..., [2, 1, 0]] * [1, 1, -1])
refused(ValueError, ["array: ", "60 degrees", "a person who lies"], lambda: teleopd.certify(lying, robot))

# The lock is released: this thread goes on while another one computes.
worker = threading.Thread(target=lambda: teleopd.certify(motion, robot))
worker.start()
rounds = 0
while worker.is_alive():
    time.sleep(1e-3)
    rounds += 1
assert rounds > 20, rounds

# Ctrl-C ends a computation, and nothing else.
signal.signal(signal.SIGALRM, signal.default_int_handler)
signal.setitimer(signal.ITIMER_REAL, 0.2)
refused(KeyboardInterrupt, [], lambda: teleopd.certify(teleopd.read_motion("builtin"), robot))
assert np.array_equal(retargeter.retarget(motion), q)

# Denormal numbers stay what they are in the caller's thread.
assert np.float64(5e-324) != 0 and np.float64(2.3e-308) / 2 != 0
