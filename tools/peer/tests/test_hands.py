"""The grippers of the peer: fingers that stop at an object, and a judge of range, speed and rest after the last message."""

import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest

PEER = Path(__file__).parents[1]
sys.path.insert(0, str(PEER))
import hands  # noqa: E402
from robot import load  # noqa: E402
from trajectory import Controller, Message, Point  # noqa: E402

PERIOD_S = 0.01
ROBOTS = {name: load(PEER.parents[1] / f"config/robots/{name}.toml", None) for name in ("tiago_dual", "tiago_dual_pal_gripper")}
PAL = ROBOTS["tiago_dual_pal_gripper"].grippers["gripper_left_controller"]


def at(closure):
    return PAL.open + closure * (PAL.closed - PAL.open)


def judged(closures, messages_until_s=np.inf):
    judge = hands.Judge(PAL, PERIOD_S)
    for tick, closure in enumerate(closures):
        if tick * PERIOD_S <= messages_until_s:
            judge.traffic.arrived(tick * PERIOD_S, None)
        judge.observe(tick * PERIOD_S, at(closure))
    return judge.report()


@pytest.mark.parametrize("name, joints", [("tiago_dual", 3), ("tiago_dual_pal_gripper", 2)])
def test_robot_files_have_two_grippers_and_the_description_their_fingers(name, joints):
    robot = ROBOTS[name]
    assert [len(gripper.joints) for gripper in robot.grippers.values()] == [joints, joints]
    root = ElementTree.fromstring(hands.described(robot.urdf, robot.grippers))
    for gripper in robot.grippers.values():
        for joint, first, last in zip(gripper.joints, gripper.open, gripper.closed):
            found = root.findall(f"joint[@name='{joint}']")
            limit = found[0].find("limit")
            assert len(found) == 1 and found[0].get("type") in ("prismatic", "revolute")
            assert float(limit.get("lower")) <= min(first, last) and float(limit.get("upper")) >= max(first, last)
            assert joint not in robot.others


def test_fingers_stop_at_an_object_and_press():
    fingers = hands.Fingers(PAL, 0.045)
    fingers.move(at(0.4), PERIOD_S)
    assert np.allclose(fingers.position, at(0.4)) and not fingers.effort.any()
    fingers.move(at(0.55), PERIOD_S)
    assert np.allclose(fingers.position, at(0.5)) and np.allclose(fingers.effort, -hands.EFFORT_MAX / 2), "they close downwards"
    fingers.move(at(1.0), PERIOD_S)
    assert np.allclose(fingers.position, at(0.5)) and np.allclose(fingers.effort, -hands.EFFORT_MAX)
    nothing = hands.Fingers(PAL, 0.0)
    nothing.move(at(1.0), PERIOD_S)
    assert np.allclose(nothing.position, PAL.closed) and not nothing.effort.any()


def test_closing_at_the_largest_speed_is_accepted():
    report = judged(np.minimum(np.arange(0, 1.2, PERIOD_S) * PAL.speed, 1.0))
    assert report["exceeded_updates"] == {"position": 0, "speed": 0}
    assert report["speed_share"] == pytest.approx(1.0) and report["closure_range"] == [0.0, 1.0]


def test_range_and_speed_are_judged():
    assert judged([0.0, 2 * PAL.speed * PERIOD_S])["exceeded_updates"] == {"position": 0, "speed": 1}
    assert judged([-0.01, -0.01])["exceeded_updates"] == {"position": 2, "speed": 0}
    assert judged([1.02])["position_excess"] == pytest.approx(0.02)


def test_fingers_that_move_on_after_the_last_message_are_seen():
    report = judged(np.minimum(np.arange(0, 1.0, PERIOD_S), 0.5), messages_until_s=0.2)
    assert report["moved_after_a_message_max_ms"] == pytest.approx(300)


def test_controller_gives_up_a_goal_that_an_object_blocks_unless_messages_go_on():
    for repeats in (False, True):
        controller, fingers = Controller(PAL.joints, *hands.GOAL), hands.Fingers(PAL, 0.045)
        for tick in range(200):
            now_ns = 10**9 + tick * 10_000_000
            if tick == 0 or (repeats and tick % 10 == 0):
                points = [Point(0, at(1.0), 0 * PAL.open), Point(300_000_000, at(1.0), 0 * PAL.open)]
                assert controller.receive(Message(now_ns - 1, PAL.joints, points), now_ns) is None
            fingers.move(controller.update(now_ns, fingers.position).positions, PERIOD_S)
        assert (fingers.effort.any(), repeats) in ((True, True), (False, False))
