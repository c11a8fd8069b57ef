"""Judges what the joints were commanded and what they did. It knows nothing of the program that sends the commands."""

from collections import Counter

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from robot import Robot

#: Rounding, relative to a limit.
ROUNDING = 1e-6
#: A joint slower than this stands still, rad/s or m/s. It is an assumption.
REST = 1e-3


class Motion:
    """The worst of one curve of all joints: position, velocity and acceleration against the limits."""

    def __init__(self, robot: "Robot"):
        self.robot = robot
        self.before: tuple[np.ndarray, np.ndarray | None] | None = None
        self.worst = {key: np.zeros(len(robot.joints)) for key in ("position_excess", "velocity_share", "acceleration_share")}
        self.exceeded = dict.fromkeys(self.worst, 0)

    def observe(self, period_s: float, position: np.ndarray, velocity: np.ndarray | None = None) -> None:
        """Takes the velocity from differences if none is given."""
        if velocity is None and self.before is not None:
            velocity = (position - self.before[0]) / period_s
        robot, excess = self.robot, np.maximum(self.robot.lower - position, position - self.robot.upper)
        self._take("position_excess", excess, ROUNDING)
        if velocity is not None:
            self._take("velocity_share", np.abs(velocity) / robot.velocity_max, 1 + ROUNDING)
            if self.before is not None and self.before[1] is not None:
                acceleration = np.abs(velocity - self.before[1]) / period_s
                self._take("acceleration_share", acceleration / robot.acceleration_max, 1 + ROUNDING)
        self.before = position.copy(), None if velocity is None else velocity.copy()

    def _take(self, key: str, values: np.ndarray, bound: float) -> None:
        np.maximum(self.worst[key], values, out=self.worst[key])
        self.exceeded[key] += int((values > bound).any())

    def report(self) -> dict:
        return {key: {"exceeded_updates": self.exceeded[key], "worst": float(values.max()),
                      "joint": self.robot.joints[int(values.argmax())], "each": dict(zip(self.robot.joints, values.round(6).tolist()))}
                for key, values in self.worst.items()}


class Traffic:
    """Messages on one command topic."""

    def __init__(self):
        self.received = self.lost = self.accepted = 0
        self.rejected: Counter[str] = Counter()
        self.last_s: float | None = None
        self.gap_max_s = 0.0
        #: Longest time for which the controller's joints still moved after a message that none had followed yet.
        self.moving_on_s = 0.0

    def arrived(self, now_s: float, reason: str | None) -> None:
        """A message that no fault took away, and why the controller refused it."""
        if reason:
            self.rejected[reason] += 1
        else:
            self.accepted += 1
        self.gap_max_s = max(self.gap_max_s, now_s - (now_s if self.last_s is None else self.last_s))
        self.last_s = now_s

    def moves(self, now_s: float) -> None:
        """The controller's joints move at `now_s`."""
        if self.last_s is not None:
            self.moving_on_s = max(self.moving_on_s, now_s - self.last_s)

    def report(self) -> dict:
        return {"received": self.received, "lost_by_fault": self.lost, "accepted": self.accepted,
                "rejected": dict(self.rejected), "gap_max_ms": round(1e3 * self.gap_max_s, 1),
                "moved_after_a_message_max_ms": round(1e3 * self.moving_on_s, 1)}


class Judge:
    def __init__(self, robot: "Robot", period_s: float):
        self.period_s, self.robot = period_s, robot
        self.command, self.measured = Motion(robot), Motion(robot)
        self.traffic = {name: Traffic() for name in robot.controllers}
        self.at_rest_s = self.moving_s = 0.0
        self.torque_share = np.zeros(len(robot.joints))
        self.saturated_steps = 0
        self.contacts: dict[str, dict] = {}
        self.touching: set[str] = set()

    def observe(self, now_s: float, command: np.ndarray, body) -> None:
        """One update at `now_s`. `body` is `body.Body` or `body.Ideal` after it moved."""
        if self.command.before is not None:
            moving = np.abs(command - self.command.before[0]) > REST * self.period_s
            for name, joints in self.robot.controllers.items():
                if any(moving[self.robot.joints.index(joint)] for joint in joints):
                    self.traffic[name].moves(now_s)
        self.command.observe(self.period_s, command)
        self.measured.observe(self.period_s, body.position, body.velocity)
        rest = np.abs(body.velocity).max() < REST
        self.at_rest_s += self.period_s * rest
        self.moving_s += self.period_s * (not rest)
        np.maximum(self.torque_share, body.torque_share, out=self.torque_share)
        self.saturated_steps += body.saturated_steps
        for pair, depth_m in body.contacts.items():
            row = self.contacts.setdefault(pair, {"times": 0, "duration_s": 0.0, "deepest_mm": 0.0})
            row["times"] += pair not in self.touching
            row["duration_s"] = round(row["duration_s"] + self.period_s, 6)
            row["deepest_mm"] = max(row["deepest_mm"], round(1e3 * depth_m, 3))
        self.touching = set(body.contacts)

    def report(self) -> dict:
        return {
            "at_rest_s": round(self.at_rest_s, 3), "moving_s": round(self.moving_s, 3),
            "command": self.command.report(), "measured": self.measured.report(),
            "torque_share": {"worst": float(self.torque_share.max()), "each": dict(zip(self.robot.joints, self.torque_share.round(4).tolist())),
                             "saturated_steps": self.saturated_steps},
            "contacts": self.contacts,
            "controllers": {name: traffic.report() for name, traffic in self.traffic.items()},
        }
