"""The oracles of the robots that hold their last position, and the bytes of Unitree's messages."""

import struct
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1]))
pytest.importorskip("cyclonedds")
import arm_sdk  # noqa: E402
import forward  # noqa: E402
import unitree  # noqa: E402

JOINTS = arm_sdk.JOINTS[12:]


def command(weight=0.0, sent_s=0.0, **changes):
    message = unitree.GenericLowCmd(mode_machine=arm_sdk.MODE_MACHINE)
    for index in arm_sdk.MOVED:
        message.motor_cmd[index] = unitree.MotorCmd(1, 0.01 * index, 0.0, 0.5, 80.0, 3.0)
    message.motor_cmd[arm_sdk.WEIGHT].q = weight
    for key, value in changes.items():
        setattr(message, key, value)
    parsed = unitree.parse_command(message.serialize(use_version_2=False))
    parsed.crc, parsed.sent_s = parsed.expected_crc(), sent_s
    return parsed


def test_crc_is_that_of_the_description_bit_by_bit():
    data, expected = bytes(range(200)) * 5, 0xFFFFFFFF
    for (word,) in struct.iter_unpack("<I", data):
        for bit in range(31, -1, -1):
            expected = (expected << 1 & 0xFFFFFFFF) ^ (0x04C11DB7 if (expected >> 31) ^ (word >> bit & 1) else 0)
    assert arm_sdk.crc(data) == expected


def test_bytes_by_hand_are_those_of_cyclone_dds():
    parsed = command(0.25)
    assert parsed.mode_machine == arm_sdk.MODE_MACHINE and parsed.values[arm_sdk.WEIGHT, 0] == 0.25
    assert parsed.modes.tolist() == [int(index in arm_sdk.MOVED) for index in range(arm_sdk.MOTORS)]
    position, velocity = np.arange(29) * 0.125, np.arange(29) * -0.25
    packed = unitree.pack_state(5, 7, position.tolist(), velocity.tolist())
    state = unitree.GenericLowState.deserialize(packed)
    assert (state.mode_machine, state.tick) == (5, 7)
    assert [(m.q, m.dq) for m in state.motor_state[:29]] == list(zip(position, velocity))
    assert state.serialize(use_version_2=False)[4:] == packed[4:]


def test_arms_are_blended_by_a_weight_that_must_not_jump():
    robot, home = arm_sdk.Controller(JOINTS), np.zeros(17)
    assert robot.receive(command(0.5), 0) == "weight too fast"
    for step in range(501):
        assert robot.receive(command(0.002 * step, sent_s=0.01 * step), 0) is None
        if step == 250:
            assert np.allclose(robot.update(0, home).positions, 0.005 * np.arange(12, 29))
    assert np.allclose(robot.update(0, home).positions, 0.01 * np.arange(12, 29))
    wrong = command(1.0, 5.0)
    wrong.crc ^= 1
    assert robot.receive(wrong, 0) == "crc"
    assert robot.receive(command(1.0, 5.0, mode_machine=1), 0) == "mode"
    leg = unitree.GenericLowCmd().motor_cmd
    leg[3] = unitree.MotorCmd(mode=1)
    assert robot.receive(command(1.0, 5.0, motor_cmd=leg), 0) == "another motor"


def test_forward_controller_holds_the_last_of_the_right_size():
    controller = forward.Controller(["a", "b"])
    assert controller.update(0, np.array([3.0, 4.0])).positions.tolist() == [3.0, 4.0]
    assert controller.receive(np.zeros(3), 0) == "size"
    assert controller.receive(np.array([1.0, np.nan]), 0) == "not finite"
    assert controller.receive(np.array([1.0, 2.0]), 0) is None
    assert controller.update(0, np.zeros(2)).positions.tolist() == [1.0, 2.0]
    assert controller.update(10**12, np.zeros(2)).positions.tolist() == [1.0, 2.0], "nothing times out"
