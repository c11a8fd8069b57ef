"""Robots as MuJoCo models. Writing one needs NumPy alone; `play` needs MuJoCo: `pip install mujoco`.

    python3 -m teleopd.mjcf tiago_dual --out tiago_dual.xml

The model has every link and joint of the robot's URDF. Its shapes are the robot's capsules, and the pairs that touch are those that the
certificate checks. Meshes, obstacles, payloads and the friction of joints are left out. The base is fixed.
"""

from __future__ import annotations

import argparse
import sys
import time
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import Robot, Trajectory

#: Step of the simulation, s. An assumption: a tenth of the period of the stiffest joint.
STEP_S = 0.001
#: Deviation at which a position actuator gives its whole effort, rad and m. An assumption, as stiff as drives of such robots are.
FULL_EFFORT_AT = {"hinge": 0.02, "slide": 0.002}
#: Acceleration at which a motor's own rotor takes its whole effort, rad/s^2 and m/s^2. An assumption, as in tools/peer.
ROTOR_ACCELERATION = 200.0
#: MuJoCo refuses moving parts without mass and inertia, kg and kg m^2. The lightest finger has more.
MASS_MIN, INERTIA_MIN = 1e-5, 1e-8
#: Effort of a joint whose URDF gives none, N m or N. An assumption: it is no commanded one.
EFFORT_OTHER = 10.0


def _numbers(values: Iterable[float]) -> str:
    return " ".join(repr(float(value)) for value in values)


def _vector(element: ElementTree.Element | None, key: str, default: str = "0 0 0") -> NDArray[np.float64]:
    text = default if element is None else element.get(key, default)
    return np.array([float(part) for part in text.split()])


def _rotation(rpy: NDArray[np.float64]) -> NDArray[np.float64]:
    """The matrix of fixed-axis roll, pitch and yaw, as URDF has them."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy), np.sin(rpy)
    return np.array([[cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
                     [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
                     [-sp, cp * sr, cp * cr]])


def _quaternion(matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """The unit quaternion w x y z of a rotation: the largest eigenvector of Bar-Itzhack's symmetric matrix."""
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = matrix
    symmetric = np.array([[xx + yy + zz, zy - yz, xz - zx, yx - xy],
                          [zy - yz, xx - yy - zz, xy + yx, xz + zx],
                          [xz - zx, xy + yx, yy - xx - zz, yz + zy],
                          [yx - xy, xz + zx, yz + zy, zz - xx - yy]])
    return np.linalg.eigh(symmetric)[1][:, -1]


def _inertial(link: ElementTree.Element) -> ElementTree.Element | None:
    """The mass of a link, with an inertia that a body can have. The URDF's moments grow by as little as that takes."""
    found = link.find("inertial")
    if found is None:
        return None
    origin, inertia, mass = found.find("origin"), found.find("inertia"), found.find("mass")
    if inertia is None or mass is None:
        raise ValueError(f"link {link.get('name')}: inertial lacks mass or inertia")
    keys = (("ixx", "ixy", "ixz"), ("ixy", "iyy", "iyz"), ("ixz", "iyz", "izz"))
    moments, axes = np.linalg.eigh(np.array([[float(inertia.get(key, "0")) for key in row] for row in keys]))
    moments = np.maximum(moments, INERTIA_MIN)
    # MuJoCo compares exactly, so rounding gets a millionth.
    moments[:2] += max(0.0, moments[2] * (1 + 1e-6) - moments[0] - moments[1]) / 2
    axes = axes * np.array([1.0, 1.0, np.sign(np.linalg.det(axes))])
    return ElementTree.Element("inertial", {
        "pos": _numbers(_vector(origin, "xyz")),
        "quat": _numbers(_quaternion(_rotation(_vector(origin, "rpy")) @ axes)),
        "mass": repr(max(float(mass.get("value", "0")), MASS_MIN)),
        "diaginertia": _numbers(moments),
    })


class _Writer:
    """One model. Its joints stand in the order in which MuJoCo numbers them."""

    def __init__(self, robot: Robot) -> None:
        self.robot, self.urdf = robot, ElementTree.fromstring(robot._native.urdf)
        self.links = {link.get("name", ""): link for link in self.urdf.iter("link")}
        self.below: dict[str, list[ElementTree.Element]] = {}
        for joint in self.urdf.iter("joint"):
            self.below.setdefault(joint.find("parent").get("link"), []).append(joint)  # type: ignore[union-attr,arg-type]
        #: names of the moving bodies, by the number that `Robot.forward` gives them
        self.bodies: dict[int, str] = {}
        #: poses of the links below the base at zero, 4 x 4
        self.at_zero: dict[str, NDArray[np.float64]] = {}
        self.joints: list[str] = []
        #: joint, type and effort of each that an actuator holds
        self.driven: dict[str, tuple[str, float]] = {}
        self.mimics: list[tuple[str, str, str, str]] = []

    def written(self) -> str:
        robot = self.robot
        root = ElementTree.Element("mujoco", {"model": robot.name})
        ElementTree.SubElement(root, "compiler", angle="radian", autolimits="true", inertiafromgeom="false",
                               boundmass=repr(MASS_MIN), boundinertia=repr(INERTIA_MIN))
        ElementTree.SubElement(root, "option", timestep=repr(STEP_S), integrator="implicitfast")
        world = ElementTree.SubElement(root, "worldbody")
        ElementTree.SubElement(world, "light", directional="true", pos="0 0 3", dir="0 0 -1")
        children = {joint.find("child").get("link") for joint in self.urdf.iter("joint")}  # type: ignore[union-attr]
        base = next(name for name in self.links if name not in children)
        self._body(world, base, None, np.eye(4))
        # The robot file says how high the base stands. Every joint shows it where it has no motion.
        height_m = robot.forward(np.zeros(len(robot.joint_names)))[1, 2, 3] - self.at_zero[self.bodies[1]][2, 3]
        root.find("worldbody/body").set("pos", _numbers((0.0, 0.0, height_m)))  # type: ignore[union-attr]
        self._geoms(root, world)
        self._actuators(root)
        if self.mimics:
            equality = ElementTree.SubElement(root, "equality")
            for joint, other, offset, multiplier in self.mimics:
                ElementTree.SubElement(equality, "joint", joint1=joint, joint2=other, polycoef=f"{offset} {multiplier} 0 0 0")
        home = dict(zip(robot.joint_names, robot.home))
        keyframe = ElementTree.SubElement(root, "keyframe")
        ElementTree.SubElement(keyframe, "key", name="home", qpos=_numbers(home.get(name, 0.0) for name in self.joints),
                               ctrl=_numbers(home.get(name, 0.0) for name in self._order()))
        ElementTree.indent(root)
        return ElementTree.tostring(root, encoding="unicode") + "\n"

    def _body(self, parent: ElementTree.Element, link: str, joint: ElementTree.Element | None, above: NDArray[np.float64]) -> None:
        origin = None if joint is None else joint.find("origin")
        step = np.eye(4)
        step[:3, :3], step[:3, 3] = _rotation(_vector(origin, "rpy")), _vector(origin, "xyz")
        self.at_zero[link] = above @ step
        # MuJoCo's own body is called world.
        body = ElementTree.SubElement(parent, "body", name="world_link" if link == "world" else link, pos=_numbers(_vector(origin, "xyz")), gravcomp="1",
                                      quat=_numbers(_quaternion(_rotation(_vector(origin, "rpy")))))
        if joint is not None and joint.get("type") != "fixed":
            self._joint(body, joint)
        inertial = _inertial(self.links[link])
        if inertial is not None:
            body.append(inertial)
        for below in self.below.get(link, []):
            self._body(body, below.find("child").get("link", ""), below, self.at_zero[link])  # type: ignore[union-attr]

    def _joint(self, body: ElementTree.Element, joint: ElementTree.Element) -> None:
        name, kind = joint.get("name", ""), "slide" if joint.get("type") == "prismatic" else "hinge"
        limit, mimic = joint.find("limit"), joint.find("mimic")
        effort = float("nan" if limit is None else limit.get("effort", "nan"))
        effort = effort if effort > 0 else EFFORT_OTHER
        made = ElementTree.SubElement(body, "joint", name=name, type=kind, axis=_numbers(_vector(joint.find("axis"), "xyz", "1 0 0")),
                                      armature=repr(effort / ROTOR_ACCELERATION))
        if limit is not None and joint.get("type") != "continuous":
            made.set("range", f"{limit.get('lower', '0')} {limit.get('upper', '0')}")
        self.joints.append(name)
        if mimic is not None:
            self.mimics.append((name, mimic.get("joint", ""), mimic.get("offset", "0"), mimic.get("multiplier", "1")))
            return
        # The drives carry the weight of what they hold, within their effort.
        made.set("actuatorgravcomp", "true")
        made.set("actuatorfrcrange", _numbers((-effort, effort)))
        self.driven[name] = (kind, effort)
        if name in self.robot.joint_names:
            self.bodies[1 + self.robot.joint_names.index(name)] = body.get("name", "")

    def _geoms(self, root: ElementTree.Element, world: ElementTree.Element) -> None:
        by_name = {body.get("name"): body for body in root.iter("body")}
        for name, body, (a, b), radius_m in self.robot._native.capsules:
            place = {"fromto": _numbers([*a, *b]), "type": "capsule"} if np.linalg.norm(np.subtract(a, b)) > 1e-6 else {
                "pos": _numbers(a), "type": "sphere"}
            # Only the pairs below touch.
            ElementTree.SubElement(by_name[self.bodies[body]] if body else world, "geom", {
                "name": name, "size": repr(radius_m), "contype": "0", "conaffinity": "0", "rgba": "0.6 0.65 0.7 1", **place})
        contact = ElementTree.SubElement(root, "contact")
        names = [capsule[0] for capsule in self.robot._native.capsules]
        for first, second in self.robot._native.pairs:
            ElementTree.SubElement(contact, "pair", geom1=names[first], geom2=names[second])

    def _order(self) -> list[str]:
        """Joints with an actuator: the commanded ones in the order of the library, then the others, which hold zero."""
        return [*self.robot.joint_names, *(name for name in self.driven if name not in self.robot.joint_names)]

    def _actuators(self, root: ElementTree.Element) -> None:
        actuator, limits = ElementTree.SubElement(root, "actuator"), self.robot.limits
        for name in self._order():
            kind, effort = self.driven[name]
            made = ElementTree.SubElement(actuator, "position", name=name, joint=name, kp=repr(effort / FULL_EFFORT_AT[kind]),
                                          dampratio="1", forcerange=_numbers((-effort, effort)))
            if name in self.robot.joint_names:
                at = self.robot.joint_names.index(name)
                made.set("ctrlrange", _numbers((limits["position_min"][at], limits["position_max"][at])))


def model(robot: Robot | str = "tiago_dual") -> str:
    """The MJCF text of a robot.

    The first controls are the commanded joints, in the order of `Robot.joint_names`, rad or m. The keyframe `home` is the home posture.

        >>> import teleopd
        >>> text = teleopd.mjcf.model("tiago_dual")
        >>> text.count("<position "), "<key name=\\"home\\"" in text
        (17, True)
    """
    return _Writer(robot if isinstance(robot, Robot) else Robot(robot)).written()


@dataclass(frozen=True)
class Played:
    """What MuJoCo's robot did with a trajectory. `print` shows it as a table."""

    #: names of the joints
    joints: list[str]
    #: "rad" or "m", for each joint
    units: list[str]
    #: deviation of the measured position from the command at each row, (N, joints), rad or m
    error: NDArray[np.float64]
    #: deepest overlap of each pair of capsules that touched, mm
    contacts_mm: dict[tuple[str, str], float]

    def __str__(self) -> str:
        lines = [f"{'tracking error, mrad or mm':32} {'mean':>8} {'p95':>8} {'largest':>8}"]
        for name, error in zip(self.joints, 1e3 * np.abs(self.error.T)):
            lines.append(f"{name:32} {error.mean():8.2f} {np.percentile(error, 95):8.2f} {error.max():8.2f}")
        lines.append(f"{'contacts':32} {len(self.contacts_mm) or 'none':>8}")
        lines += [f"{first}, {second}: {depth:.1f} mm" for (first, second), depth in sorted(self.contacts_mm.items())]
        return "\n".join(lines)


def play(trajectory: Trajectory, viewer: bool = False) -> Played:
    """Plays a trajectory in MuJoCo, with a window in real time or without one. Its rows should be at least 50 a second.

        >>> import teleopd
        >>> trajectory = teleopd.certify(teleopd.read_motion("builtin"))
        >>> print(teleopd.mjcf.play(trajectory))  # doctest: +SKIP
    """
    try:
        import mujoco  # type: ignore[import-untyped]
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError("teleopd.mjcf.play needs mujoco: pip install mujoco", name=error.name) from None

    robot, steps = trajectory.robot, max(1, round(1.0 / (trajectory.rate_hz * STEP_S)))
    compiled: Any = mujoco.MjModel.from_xml_string(model(robot))
    compiled.opt.timestep = 1.0 / (trajectory.rate_hz * steps)
    data: Any = mujoco.MjData(compiled)
    mujoco.mj_resetDataKeyframe(compiled, data, 0)
    at = np.array([compiled.joint(name).qposadr[0] for name in robot.joint_names])
    data.qpos[at] = trajectory.positions[0]
    count, before = len(at), trajectory.positions[0]
    # A drive knows the commanded velocity. Here it is a part of the position, which makes up for the actuator's damping.
    ahead = -compiled.actuator_biasprm[:count, 2] / compiled.actuator_gainprm[:count, 0] * trajectory.velocities
    deviation = np.empty_like(trajectory.positions)
    contacts: dict[tuple[str, str], float] = {}
    window = None
    if viewer:
        import mujoco.viewer  # type: ignore[import-untyped]
        window = mujoco.viewer.launch_passive(compiled, data)
    begun = time.monotonic()
    for row, command in enumerate(trajectory.positions):
        for step in range(1, steps + 1):
            share = step / steps
            data.ctrl[:count] = before + (command - before) * share + ahead[max(0, row - 1)] * (1 - share) + ahead[row] * share
            mujoco.mj_step(compiled, data)
            for index in range(data.ncon):
                contact = data.contact[index]
                if contact.dist < 0:
                    first, second = sorted(compiled.geom(geom).name for geom in contact.geom)
                    contacts[first, second] = max(contacts.get((first, second), 0.0), -1e3 * float(contact.dist))
        deviation[row], before = data.qpos[at] - command, command
        if window is not None:
            if not window.is_running():
                deviation = deviation[: row + 1]
                break
            window.sync()
            time.sleep(max(0.0, begun + (row + 1) / trajectory.rate_hz - time.monotonic()))
    return Played(robot.joint_names, robot.units, deviation, contacts)


def main(arguments: list[str] | None = None) -> int:
    """The command `python3 -m teleopd.mjcf`."""
    parser = argparse.ArgumentParser(prog="python3 -m teleopd.mjcf", description="Writes the MuJoCo model (MJCF) of a robot.")
    parser.add_argument("robot", help="a robot of the package, such as tiago_dual, or a robot file")
    parser.add_argument("--out", type=Path, help="the file (default: the standard output)")
    given = parser.parse_args(arguments)
    try:
        text = model(given.robot)
        if given.out is None:
            sys.stdout.write(text)
        else:
            given.out.write_text(text)
    except (OSError, ValueError) as error:
        print(f"teleopd.mjcf: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
