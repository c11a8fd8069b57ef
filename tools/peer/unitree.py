"""The messages of `unitree_hg` that the peer reads and writes, as DDS types, and the same bytes written by hand.

The generic writer takes milliseconds for a state. So `pack_state` writes the bytes, and
`parse_command` reads them. The tests compare both with the generic reader and writer.
"""

import struct
from dataclasses import dataclass, field

import numpy as np
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import array, float32, int16, uint8, uint32

import arm_sdk


def zeros(count: int, value=0):
    return field(default_factory=lambda: [value] * count)


@dataclass
class MotorCmd(IdlStruct, typename="unitree_hg::msg::dds_::MotorCmd_"):
    mode: uint8 = 0
    q: float32 = 0.0
    dq: float32 = 0.0
    tau: float32 = 0.0
    kp: float32 = 0.0
    kd: float32 = 0.0
    reserve: uint32 = 0


def low_cmd():
    @dataclass
    class LowCmd(IdlStruct, typename="unitree_hg::msg::dds_::LowCmd_"):
        mode_pr: uint8 = 0
        mode_machine: uint8 = 0
        motor_cmd: array[MotorCmd, arm_sdk.MOTORS] = field(default_factory=lambda: [MotorCmd() for _ in range(arm_sdk.MOTORS)])
        reserve: array[uint32, 4] = zeros(4)
        crc: uint32 = 0

    return LowCmd


@dataclass
class IMUState(IdlStruct, typename="unitree_hg::msg::dds_::IMUState_"):
    quaternion: array[float32, 4] = zeros(4, 0.0)
    gyroscope: array[float32, 3] = zeros(3, 0.0)
    accelerometer: array[float32, 3] = zeros(3, 0.0)
    rpy: array[float32, 3] = zeros(3, 0.0)
    temperature: int16 = 0


@dataclass
class MotorState(IdlStruct, typename="unitree_hg::msg::dds_::MotorState_"):
    mode: uint8 = 0
    q: float32 = 0.0
    dq: float32 = 0.0
    ddq: float32 = 0.0
    tau_est: float32 = 0.0
    temperature: array[int16, 2] = zeros(2)
    vol: float32 = 0.0
    sensor: array[uint32, 2] = zeros(2)
    motorstate: uint32 = 0
    reserve: array[uint32, 4] = zeros(4)


def low_state():
    @dataclass
    class LowState(IdlStruct, typename="unitree_hg::msg::dds_::LowState_"):
        version: array[uint32, 2] = zeros(2)
        mode_pr: uint8 = 0
        mode_machine: uint8 = 0
        tick: uint32 = 0
        imu_state: IMUState = field(default_factory=IMUState)
        motor_state: array[MotorState, arm_sdk.MOTORS] = field(default_factory=lambda: [MotorState() for _ in range(arm_sdk.MOTORS)])
        wireless_remote: array[uint8, 40] = zeros(40)
        reserve: array[uint32, 4] = zeros(4)
        crc: uint32 = 0

    return LowState


#: Values of a motor, and the mode of the next one.
MOTOR = np.dtype([("values", "<f4", 5), ("reserve", "<u4"), ("next_mode", "u1"), ("padding", "u1", 3)])
#: Length of all of them, bytes. After the last motor there is no next mode.
MOTORS_BYTES = arm_sdk.MOTORS * MOTOR.itemsize - 4


def parse_command(data: bytes, **_) -> arm_sdk.Command:
    """Reads little-endian CDR. It aligns each field to its own size, so the first motor's mode follows the two modes at once."""
    body = data[4:]
    motors = np.frombuffer(body[4:4 + MOTORS_BYTES] + bytes(4), MOTOR).copy()
    motors["padding"] = 0
    modes = np.concatenate([[body[2]], motors["next_mode"][:-1]])
    end = 4 + MOTORS_BYTES
    laid_out = bytes([body[0], body[1], 0, 0, body[2], 0, 0, 0]) + motors.tobytes()[:MOTORS_BYTES] + body[end:end + 16]
    reserves = np.concatenate([motors["reserve"], np.frombuffer(body, "<u4", 4, end)])
    crc = int(np.frombuffer(body, "<u4", 1, end + 16)[0])
    return arm_sdk.Command(body[0], body[1], modes, motors["values"], reserves, crc, laid_out)


#: CDR of a state: versions, modes, tick, orientation, motors, what the operator holds, reserve, CRC.
STATE = struct.Struct("<2I2B2xI13fh" + "Bx2f11I" + "B3x2f11I" * (arm_sdk.MOTORS - 1) + "40B5I")


def pack_state(mode_machine: int, tick: int, position, velocity) -> bytes:
    """CDR of a state whose motors are at `position` (rad, rad/s)."""
    there = [value for q, dq in zip(position, velocity) for value in (1, q, dq, *NOTHING)]
    absent = [1, 0.0, 0.0, *NOTHING] * (arm_sdk.MOTORS - len(position))
    return b"\0\1\0\0" + STATE.pack(0, 0, 0, mode_machine, tick, *[0.0] * 13, 0, *there, *absent, *[0] * 45)


#: The words of a motor's state after its velocity.
NOTHING = [0] * 11


#: The generic reader and writer, and those by hand. A state by hand has its bytes in `packed`.
GenericLowCmd, GenericLowState, LowCmd, LowState = low_cmd(), low_state(), low_cmd(), low_state()
LowCmd.deserialize = staticmethod(parse_command)
LowState.serialize = lambda self, *_, **__: self.packed
