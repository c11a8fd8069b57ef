"""Plays certified trajectories of every shipped robot in MuJoCo without a window, and compares the model with the library.

    mujoco_plays.py
"""

import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import mujoco
import numpy as np
import teleopd

repository = Path(__file__).resolve().parents[3]
names = sorted(path.stem for path in (repository / "config/robots").glob("*.urdf"))
assert len(names) >= 6, names
random = np.random.default_rng(1)
whole = teleopd.read_motion("builtin")
motion = teleopd.Motion(whole.positions[400:560], whole.rotations[400:560], whole.rate_hz)

for name in names:
    robot = teleopd.Robot(name)
    model = mujoco.MjModel.from_xml_string(teleopd.mjcf.model(robot))
    data = mujoco.MjData(model)
    urdf = ElementTree.fromstring(robot._native.urdf)

    # The same bodies: places, mass and controls.
    mujoco.mj_resetDataKeyframe(model, data, model.key("home").id)
    at = [model.joint(joint).qposadr[0] for joint in robot.joint_names]
    assert np.allclose(data.qpos[at], robot.home) and np.allclose(data.ctrl[: len(at)], robot.home)
    assert [model.actuator(index).name for index in range(len(at))] == robot.joint_names
    low, high = robot.limits["position_min"], robot.limits["position_max"]
    assert np.allclose(model.actuator_ctrlrange[: len(at)].T, [low, high])
    assert np.allclose(model.actuator_forcerange[: len(at), 1], robot.limits["effort"])
    mass = sum(float(value.get("value")) for value in urdf.iter("mass"))
    assert abs(model.body_mass.sum() - mass) < 1e-3 * len(list(urdf.iter("mass"))), (name, model.body_mass.sum(), mass)
    for _ in range(20):
        q = random.uniform(low, high)
        data.qpos[:] = 0
        data.qpos[at] = q
        mujoco.mj_forward(model, data)
        poses = robot.forward(q)
        for joint, pose in zip(robot.joint_names, poses[1:]):
            body = model.jnt_bodyid[model.joint(joint).id]
            assert np.allclose(data.xpos[body], pose[:3, 3], atol=1e-9), (name, joint)
            assert np.allclose(data.xmat[body].reshape(3, 3), pose[:3, :3], atol=1e-9), (name, joint)
        # The same shapes and pairs: MuJoCo's distance of the nearest pair is the library's clearance.
        pairs = zip(model.pair_geom1, model.pair_geom2)
        nearest = min(mujoco.mj_geomDistance(model, data, int(a), int(b), 10.0, np.zeros(6)) for a, b in pairs)
        apart = robot.clearance(q)
        # Obstacles, such as the floor, are no part of the model.
        assert abs(nearest - apart) < 1e-6 or nearest > apart, (name, nearest, apart)

    # A joint that mimics another one follows it.
    mimics = [joint for joint in urdf.iter("joint") if joint.find("mimic") is not None]
    assert model.neq == len(mimics)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    for joint in mimics:
        other = joint.find("mimic").get("joint")
        data.actuator(other).ctrl[0] = model.joint(other).range[1]
    for _ in range(1000):
        mujoco.mj_step(model, data)
    for joint in mimics:
        followed, other = data.joint(joint.get("name")).qpos[0], data.joint(joint.find("mimic").get("joint")).qpos[0]
        assert abs(other) > 0.01 and abs(followed - float(joint.find("mimic").get("multiplier", 1)) * other) < 1e-3, (name, followed, other)
    # At home the drives hold the robot.
    held = np.abs(data.qpos[at] - robot.home).max()
    assert held < 1e-3, (name, held)

    trajectory = teleopd.certify(motion, robot)
    played = teleopd.mjcf.play(trajectory)
    error = 1e3 * np.abs(played.error)
    print(f"{name}: tracking error, mrad or mm: mean {error.mean():.1f}, p95 {np.percentile(error, 95):.1f}, largest {error.max():.1f}; contacts {len(played.contacts_mm)}")
    assert 0 < error.max() < 20 and not played.contacts_mm, str(played)
    assert str(played).count("\n") == len(at) + 1

# A motion that was never certified touches itself, so the model feels it.
robot = teleopd.Robot()
trajectory = teleopd.certify(motion, robot)
low, high = robot.limits["position_min"], robot.limits["position_max"]
postures = [q for q in random.uniform(low, high, (200, len(low))) if robot.clearance(q) < -0.05][:1]
crossed = teleopd.Trajectory(**{**vars(trajectory), "positions": np.linspace(robot.home, postures[0], 200)})
assert teleopd.mjcf.play(crossed).contacts_mm

# The book's lines, without the window.
book = (repository / "docs/src/python.md").read_text()
block = next(block for block in re.findall(r"```python\n(.*?)```", book, re.S) if "mjcf" in block)
assert len(block.strip().splitlines()) == 5 and "viewer=True" in block
exec(compile(block.replace("viewer=True", "viewer=False"), "python.md", "exec"), {})

# The command of the book writes the same text.
import contextlib
import io
from teleopd.mjcf import main

written = io.StringIO()
with contextlib.redirect_stdout(written):
    assert main(["tiago_dual"]) == 0
assert written.getvalue() == teleopd.mjcf.model("tiago_dual")
assert main(["none_such"]) == 1
