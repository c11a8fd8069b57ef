"""The robot: its controllers and limits of acceleration from the robot file, everything else from the URDF."""

import math
import tomllib
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import hands

MOVABLE = ("revolute", "prismatic", "continuous")


@dataclass
class Robot:
    urdf_path: Path
    urdf: str
    #: Joints of each controller, by its name.
    controllers: dict[str, list[str]]
    #: All joints of the controllers. Arrays below are in this order, in rad, m, N m and N.
    joints: list[str]
    #: Movable joints that belong to no controller. The robot reports them too.
    others: list[str]
    home: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    velocity_max: np.ndarray
    effort_max: np.ndarray
    acceleration_max: np.ndarray
    #: Pairs of links that the robot file lets touch, because one joint connects them.
    adjacent: set[frozenset[str]]
    #: Its grippers, by the name of their controller.
    grippers: dict[str, hands.Gripper]


def load(robot_path: Path, urdf_path: Path | None) -> Robot:
    table = tomllib.loads(robot_path.read_text())
    urdf_path = urdf_path or robot_path.parent / table["urdf"]
    urdf = urdf_path.read_text()
    movable = {j.get("name"): j for j in ElementTree.fromstring(urdf).findall("joint") if j.get("type") in MOVABLE}
    controllers = {row["name"]: row["joints"] for row in table["controllers"]}
    joints = [joint for names in controllers.values() for joint in names]
    if missing := [joint for joint in joints if joint not in movable]:
        raise SystemExit(f"{urdf_path} has no movable joint {missing[0]}. {robot_path} needs it.")
    grippers = hands.load(table)
    fingers = [joint for gripper in grippers.values() for joint in gripper.joints]
    acceleration = {}
    for group in table["limits"]["groups"].values():
        limit = group.get("acceleration_max_rad_per_s2", group.get("acceleration_max_m_per_s2"))
        acceleration.update(dict.fromkeys(group["joints"], limit))
    home = table.get("home_m", {}) | table.get("home_rad", {})

    def limit(key: str, default: float) -> np.ndarray:
        return np.array([float(movable[joint].find("limit").get(key, default)) for joint in joints])

    link = {capsule["name"]: capsule["link"] for capsule in table["collision"]["capsules"]}
    adjacent = table["collision"]["allowed"]["adjacent"]
    return Robot(
        urdf_path, urdf, controllers, joints, [name for name in movable if name not in joints + fingers],
        np.array([home[joint] for joint in joints]), limit("lower", -math.inf), limit("upper", math.inf),
        limit("velocity", math.inf), limit("effort", math.inf), np.array([acceleration[joint] for joint in joints]),
        {frozenset((link[a], link[b])) for a, others in adjacent.items() for b in others}, grippers,
    )
