"""The judge against motions that break one limit, and the body against postures that touch."""

import os
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

PEER = Path(__file__).parents[1]
sys.path.insert(0, str(PEER))
import body  # noqa: E402
from judge import Judge, Motion  # noqa: E402
from robot import load  # noqa: E402

ROBOT_FILE = PEER.parents[1] / "config/robots/tiago_dual.toml"
ROBOT = load(ROBOT_FILE, None)
PERIOD_S = 0.01
JOINT = ROBOT.joints.index("arm_left_4_joint")
DESCRIPTION = os.environ.get("PEER_DESCRIPTION")


def in_mujoco(robot, meshes, allowed=()):
    pytest.importorskip("mujoco")
    return body.Body(robot, SimpleNamespace(meshes=meshes, ignored=body.NO_PARTS, allowed=allowed, joint_friction=False, feed_forward=0.0, servo_hz=None))


def judged(curve):
    """The judgement of one joint that moves away from home along `curve`."""
    motion = Motion(ROBOT)
    for value in curve:
        position = ROBOT.home.copy()
        position[JOINT] += value
        motion.observe(PERIOD_S, position)
    return {key: (value["exceeded_updates"], value["worst"]) for key, value in motion.report().items()}


def test_motion_at_the_limits_is_accepted():
    v, a, t = ROBOT.velocity_max[JOINT], ROBOT.acceleration_max[JOINT], np.arange(0, 0.3, PERIOD_S)
    speed = np.minimum(a * t, v)
    report = judged(np.cumsum(speed) * PERIOD_S - 0.5)
    assert report["velocity_share"] == (0, pytest.approx(1.0)) and report["acceleration_share"] == (0, pytest.approx(1.0))


def test_each_limit_is_judged():
    assert judged([0, 0, 0.002])["acceleration_share"] == (1, pytest.approx(0.002 / PERIOD_S**2 / ROBOT.acceleration_max[JOINT]))
    assert judged([0, 0.03, 0.03])["velocity_share"] == (1, pytest.approx(0.03 / PERIOD_S / ROBOT.velocity_max[JOINT]))
    over = ROBOT.upper[JOINT] - ROBOT.home[JOINT] + 0.01
    assert judged([over, over])["position_excess"] == (2, pytest.approx(0.01))


def test_body_stands_still_at_home_and_carries_its_weight():
    one = in_mujoco(ROBOT, None)
    for _ in range(50):
        one.move(ROBOT.home, PERIOD_S)
    assert np.abs(one.position - ROBOT.home).max() < 1e-3
    assert 0.1 < one.torque_share.max() < 0.85 and not one.saturated_steps and not one.sees_contacts


def test_motor_gives_no_more_than_its_effort():
    one, far = in_mujoco(ROBOT, None), ROBOT.home.copy()
    far[JOINT] -= 0.5
    one.move(far, PERIOD_S)
    assert one.saturated_steps > 0 and one.torque_share[JOINT] == 1.0
    assert np.abs(one.torque).max() <= ROBOT.effort_max.max()


@pytest.mark.skipif(not DESCRIPTION, reason="PEER_DESCRIPTION names no folder with tiago_dual.urdf and meshes")
def test_hands_that_meet_are_a_contact():
    robot = load(ROBOT_FILE, Path(DESCRIPTION) / "tiago_dual.urdf")
    one, judge, inwards = in_mujoco(robot, Path(DESCRIPTION)), Judge(robot, PERIOD_S), robot.home.copy()
    for side in ("left", "right"):
        inwards[robot.joints.index(f"arm_{side}_1_joint")] += 0.6
    for share in np.minimum(np.arange(0, 1.5, 0.02), 1.0):
        command = robot.home + share * (inwards - robot.home)
        one.move(command, PERIOD_S)
        judge.observe(0.0, command, one)
    contacts = judge.report()["contacts"]
    assert contacts and all("left" in pair and "right" in pair for pair in contacts), contacts
    assert all(row["times"] >= 1 and row["deepest_mm"] > 0 for row in contacts.values())


def test_motion_after_the_last_message_is_timed():
    one, judge = body.Ideal(ROBOT, 0.0), Judge(ROBOT, PERIOD_S)
    traffic = judge.traffic["arm_left_controller"]
    place = ROBOT.joints.index("arm_left_1_joint")
    for tick in range(100):
        # Messages until 0.2 s, motion until 0.5 s.
        if tick * PERIOD_S <= 0.2:
            traffic.arrived(tick * PERIOD_S, None)
        command = ROBOT.home.copy()
        command[place] += 0.1 * min(tick * PERIOD_S, 0.5)
        judge.observe(tick * PERIOD_S, command, one)
    moved = {name: row["moved_after_a_message_max_ms"] for name, row in judge.report()["controllers"].items()}
    assert moved.pop("arm_left_controller") == pytest.approx(300)
    assert not any(moved.values())
