"""An oracle of Unitree's `rt/arm_sdk` on a G1 with 29 joints. It does no input or output and reads no clock.

It is written from public examples, because the robot's own program is not public. It blends what it is sent with its own
posture by the weight, and holds both when messages end. Both are assumptions. It has no gravity, so it only bounds torques.
"""

import zlib
from dataclasses import dataclass

import numpy as np

MOTORS, WEIGHT = 35, 29
#: The robot type of g1_29dof_rev_1_0.
MODE_MACHINE = 5
#: Fastest change of the weight that the SDK's example makes, 1/s.
WEIGHT_RATE = 0.2
#: A message may come this much later than the one before it, s: two looks of its sender. It is an assumption.
LATE_S = 0.002
#: Torques that hold a G1 with empty hands upright are smaller, N m. It is an assumption.
TORQUE_MAX = 20.0
#: Time that the first message counts for, s.
FIRST_S = 0.01
LEG = ["hip_pitch", "hip_roll", "hip_yaw", "knee", "ankle_pitch", "ankle_roll"]
ARM = ["shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow", "wrist_roll", "wrist_pitch", "wrist_yaw"]
WAIST = ["waist_yaw", "waist_roll", "waist_pitch"]
#: Joints in the order of the motors.
JOINTS = [f"{name}_joint" for name in [*(f"left_{n}" for n in LEG), *(f"right_{n}" for n in LEG), *WAIST,
                                       *(f"left_{n}" for n in ARM), *(f"right_{n}" for n in ARM)]]
#: Motors that it moves: waist and arms.
MOVED = range(12, 29)


#: Each byte with its bits in reverse.
REVERSED = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))


def crc(data: bytes) -> int:
    """CRC-32 with 0x04c11db7 over little-endian words, the highest bit first. It begins with ones, and inverts nothing.

    zlib takes the lowest bit first and inverts the result. So it gets every byte in reverse, and so is what it returns.
    """
    highest_first = np.frombuffer(data, "<u4").astype(">u4").tobytes()
    return int(f"{zlib.crc32(highest_first.translate(REVERSED)) ^ 0xFFFFFFFF:032b}"[::-1], 2)


@dataclass
class Command:
    """A LowCmd. `values` has a row of q, dq, tau, kp and kd for each motor."""

    mode_pr: int
    mode_machine: int
    modes: np.ndarray
    values: np.ndarray
    reserves: np.ndarray
    crc: int
    #: The struct as C lays it out, without its last word.
    laid_out: bytes
    sent_s: float = 0.0

    def expected_crc(self) -> int:
        return crc(self.laid_out)


@dataclass
class Reference:
    positions: np.ndarray


class Controller:
    """The robot's own controller with its arms. It has the methods of `trajectory.Controller`."""

    def __init__(self, joints: list[str]):
        self.joints = joints
        self.places = [JOINTS.index(joint) for joint in joints]
        self.others = [index for index in range(MOTORS) if index not in (*self.places, WEIGHT)]
        self.own: np.ndarray | None = None
        self.sent: np.ndarray | None = None
        self.weight, self.weight_s, self.weight_max = 0.0, None, 0.0
        self.gains = np.zeros((0, 2))

    def rejection(self, message: Command) -> str | None:
        modes, values, weight = message.modes, message.values, float(message.values[WEIGHT, 0])
        if message.crc != message.expected_crc():
            return "crc"
        if message.mode_machine != MODE_MACHINE or message.mode_pr:
            return "mode"
        if not np.isfinite(values).all():
            return "not finite"
        if message.reserves.any() or modes[self.others].any() or values[self.others].any():
            return "another motor"
        own = values[self.places]
        if not set(self.places) <= set(MOVED) or (modes[self.places] != 1).any() or (own[:, 3:] <= 0).any():
            return "motor without mode or gains"
        if own[:, 1].any():
            return "velocity"
        if (np.abs(own[:, 2]) > TORQUE_MAX).any():
            return "torque"
        if not 0 <= weight <= 1 or values[WEIGHT, 1:].any() or modes[WEIGHT]:
            return "weight"
        since_s = FIRST_S if self.weight_s is None else message.sent_s - self.weight_s
        if abs(weight - self.weight) > WEIGHT_RATE * (since_s + LATE_S) + 1e-6:
            return "weight too fast"
        return None

    def receive(self, message: Command, now_ns: int) -> str | None:
        reason = self.rejection(message)
        if reason is None:
            self.sent = message.values[self.places, 0].astype(float)
            self.gains = message.values[self.places, 3:]
            self.weight, self.weight_s = float(message.values[WEIGHT, 0]), message.sent_s
            self.weight_max = max(self.weight_max, self.weight)
        return reason

    def update(self, now_ns: int, measured: np.ndarray) -> Reference:
        if self.own is None:
            self.hold(now_ns, measured)
        sent = self.own if self.sent is None else self.sent
        return Reference(self.weight * sent + (1 - self.weight) * self.own)

    def hold(self, now_ns: int, measured: np.ndarray) -> None:
        self.own = measured.copy()

    def report(self) -> dict:
        return {"weight": round(self.weight, 6), "weight_max": round(self.weight_max, 6), "gains": np.unique(self.gains, axis=0).tolist()}
