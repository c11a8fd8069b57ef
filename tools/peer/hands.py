"""The robot's grippers: their fingers, and a judge of how they move. Positions are rad or m."""

import math
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from judge import REST, Traffic

#: Effort limit of a finger in the robot's description, N m or N. It is an assumption.
EFFORT_MAX = 16.0
#: Share of the way beyond an object at which a motor gives its whole effort. It is an assumption: a stiff position loop.
FULL_EFFORT_AT = 0.1
#: The cubic between two points dips below both if the fingers begin to move in between: share of the way. The largest seen was 3e-6.
DIP = 1e-4
#: Error of a speed, as a share. The largest seen was 0.0012. The cause is an assumption: the driver's estimate of the robot's clock
#: changes from message to message.
CLOCK = 0.01
#: Goal (rad or m) and goal time (s) of a hand's controller. They are assumptions.
GOAL = (0.02, 0.6)


@dataclass
class Gripper:
    joints: list[str]
    open: np.ndarray
    closed: np.ndarray
    #: Share of the way from open to closed that the fingers make in a second at most.
    speed: float
    opening_m: float


def load(table: dict) -> dict[str, Gripper]:
    """The grippers of a robot file, by the name of their controller."""
    grippers = {}
    for hand in table.get("hands", {}).values():
        positions = [hand.get(f"{what}_m", {}) | hand.get(f"{what}_rad", {}) for what in ("open", "closed")]
        joints = list(positions[0])
        first, last = (np.array([where[joint] for joint in joints]) for where in positions)
        grippers[hand["controller"]] = Gripper(joints, first, last, 1e3 / hand["closing_time_ms"], hand["opening_m"])
    return grippers


def described(urdf: str, grippers: dict[str, Gripper]) -> str:
    """The robot's own description, which has the joints of its fingers. The one of the repository locks them or has none."""
    root = ElementTree.fromstring(urdf)
    base = root.find("link").get("name")
    for gripper in grippers.values():
        for joint, first, last in zip(gripper.joints, gripper.open, gripper.closed):
            found = root.find(f"joint[@name='{joint}']")
            if found is None:
                found = ElementTree.SubElement(root, "joint", name=joint)
                ElementTree.SubElement(found, "parent", link=base)
                ElementTree.SubElement(found, "child", link=f"{joint}_link")
                ElementTree.SubElement(root, "link", name=f"{joint}_link")
            found.set("type", "prismatic" if abs(last - first) < 0.3 else "revolute")
            if found.find("limit") is None:
                speed = abs(last - first) * gripper.speed
                ElementTree.SubElement(found, "limit", lower=str(min(first, last)), upper=str(max(first, last)),
                                       effort=str(EFFORT_MAX), velocity=str(speed))
    return ElementTree.tostring(root, encoding="unicode")


class Fingers:
    """Ideal fingers of one hand: where they were commanded, unless an object is between them. They begin open."""

    def __init__(self, gripper: Gripper, object_m: float, closure: float = 0.0):
        self.gripper = gripper
        self.range = gripper.closed - gripper.open
        self.end = 1.0 if object_m == 0 else min(max(1 - object_m / gripper.opening_m, 0.0), 1.0)
        self.has_object = object_m > 0
        self.position = gripper.open + closure * self.range
        self.velocity, self.effort = np.zeros((2, len(gripper.joints)))

    def move(self, command: np.ndarray, period_s: float) -> None:
        share = (command - self.gripper.open) / self.range
        wanted = self.gripper.open + np.minimum(share, self.end) * self.range
        self.velocity, self.position = (wanted - self.position) / period_s, wanted
        squeeze = np.clip((share - self.end) / FULL_EFFORT_AT, 0, 1) * self.has_object
        self.effort = EFFORT_MAX * squeeze * np.sign(self.range)


class Judge:
    """Judges the commands of one hand's controller by the robot file: range and speed, and rest after the last message."""

    def __init__(self, gripper: Gripper, period_s: float):
        self.gripper, self.period_s = gripper, period_s
        self.traffic = Traffic()
        self.range = np.abs(gripper.closed - gripper.open)
        self.before: np.ndarray | None = None
        self.excess = self.speed = 0.0
        self.exceeded = {"position": 0, "speed": 0}
        self.closure_range = [math.inf, -math.inf]

    def observe(self, now_s: float, command: np.ndarray) -> None:
        low, high = np.minimum(self.gripper.open, self.gripper.closed), np.maximum(self.gripper.open, self.gripper.closed)
        excess = float((np.maximum(low - command, command - high) / self.range).max())
        self.excess = max(self.excess, excess)
        self.exceeded["position"] += excess > DIP
        if self.before is not None:
            speeds = np.abs(command - self.before) / self.period_s
            share = float((speeds / (self.range * self.gripper.speed)).max())
            self.speed = max(self.speed, share)
            self.exceeded["speed"] += share > 1 + CLOCK
            if speeds.max() > REST * self.range.min():
                self.traffic.moves(now_s)
        closure = float(((command - self.gripper.open) / (self.gripper.closed - self.gripper.open)).mean())
        self.closure_range = [min(self.closure_range[0], closure), max(self.closure_range[1], closure)]
        self.before = command.copy()

    def report(self) -> dict:
        return {"position_excess": self.excess, "speed_share": self.speed, "exceeded_updates": self.exceeded,
                "closure_range": [round(closure, 4) for closure in self.closure_range], **self.traffic.report()}
