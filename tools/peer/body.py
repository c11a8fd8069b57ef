"""The robot's body: an ideal one, and one in MuJoCo."""

import copy
import io
import math
import os
import struct
import xml.etree.ElementTree as ElementTree
import zlib
from pathlib import Path

import numpy as np

from robot import Robot

#: Steps of the simulation, Hz. It is an assumption: twenty times faster than the stiffest joint swings.
STEP_HZ = 1000
#: Stiffness, N m/rad and N/m: mujoco_menagerie's model of TIAGo++ (pal_tiago_dual).
STIFFNESS = {"arm_left": (250, 1500, 600, 1000, 80, 80, 80), "arm_right": (250, 1500, 600, 1000, 80, 80, 80),
             "head": (20, 20), "torso_lift": (50000,)}
#: Any other joint is a servo of this frequency at home, Hz. It is an assumption.
SERVO_HZ = 5.0
#: Share of critical damping at home. It is an assumption.
DAMPING_RATIO = 0.5
#: Acceleration at which a geared motor's own rotor takes its whole effort, rad/s^2 and m/s^2. It is an assumption.
ROTOR_ACCELERATION = 200.0
#: Links of TIAGo++'s description that are boxes around a hand, and no part of the robot.
NO_PARTS = ("hand_left_safety_box", "hand_right_safety_box")
#: Meshes are cut into convex slabs of about this thickness, m. It is an assumption.
SLAB_M = 0.05
#: MuJoCo needs some mass and inertia of each moving part, kg and kg m^2. The lightest finger has more mass.
MASS_MIN, INERTIA_MIN = 1e-5, 1e-8
#: A part lighter than this (kg) has at most this radius of gyration (m). The radius is an assumption. The manufacturer's
#: description gives each part of a finger 0.001 kg m^2. It says that this number only steadies a simulation. A hand of such
#: fingers would turn as slowly as one with a radius of 25 cm.
LIGHT_KG, GYRATION_MAX_M = 0.1, 0.03


class Ideal:
    """Every joint is where it is commanded, or lags behind by a first order.

    A motor with stiffness k and damping d, without a commanded velocity, lags by d / k if it has no inertia.
    """

    saturated_steps = 0
    contacts: dict[str, float] = {}
    unchecked: list[tuple[str, str]] = []
    sees_contacts = False

    def __init__(self, robot: Robot, lag_s: float):
        self.lag_s = lag_s
        self.position = robot.home.copy()
        self.velocity, self.torque, self.torque_share = np.zeros((3, len(robot.joints)))

    def move(self, command: np.ndarray, period_s: float) -> None:
        share = 1.0 if self.lag_s == 0 else 1 - math.exp(-period_s / self.lag_s)
        moved = share * (command - self.position)
        self.velocity, self.position = moved / period_s, self.position + moved


class Body:
    """Links, meshes and torque-limited motors. Each motor holds its joint with a stiffness, a damping and the gravity."""

    def __init__(self, robot: Robot, args):
        """`args` has `meshes`, `ignored`, `allowed`, `joint_friction` and `feed_forward`, see `peer.py`."""
        os.environ.setdefault("MUJOCO_GL", "egl")
        import mujoco

        self.mujoco, self.robot, self.feed_forward = mujoco, robot, args.feed_forward
        spec = self.described(*prepared(robot, args))
        #: Pairs of bodies that are not checked: the fixed base and what stands on it, and hulls that overlap at home.
        self.unchecked = self.overlapping(spec.compile())
        for first, second in self.unchecked:
            spec.add_exclude(bodyname1=first, bodyname2=second)
        self.model = spec.compile()
        if args.servo_hz:
            # Rotors behind gears: without them two wrist joints in line would pull each other about.
            for joint, effort in zip(robot.joints, robot.effort_max):
                self.model.dof_armature[self.model.joint(joint).dofadr[0]] = effort / ROTOR_ACCELERATION
        self.data = self.at_home(self.model)
        self.q_at = np.array([self.model.joint(joint).qposadr[0] for joint in robot.joints])
        self.v_at = np.array([self.model.joint(joint).dofadr[0] for joint in robot.joints])
        inertia = np.zeros((self.model.nv, self.model.nv))
        mujoco.mj_fullM(self.model, self.data, inertia)
        inertia = inertia[np.ix_(self.v_at, self.v_at)]
        alone, inertia = 1 / np.diag(np.linalg.inv(inertia)), np.diag(inertia)
        if args.servo_hz:
            # The inertia that a motor feels while the others give way.
            self.stiffness, ratio = alone * (2 * math.pi * args.servo_hz) ** 2, 1.0
            inertia = alone
        else:
            self.stiffness = np.array([stiffness(joint, m) for joint, m in zip(robot.joints, inertia)])
            ratio = DAMPING_RATIO
        self.damping = 2 * ratio * np.sqrt(self.stiffness * inertia)
        #: The link of each shape.
        self.link = [self.model.geom(index).name.rsplit("#")[0] for index in range(self.model.ngeom)]
        self.sees_contacts = bool(self.link)
        self.allowed = robot.adjacent | {frozenset(pair.split(",")) for pair in args.allowed}
        self.before, self.torque = robot.home.copy(), np.zeros(len(robot.joints))
        self.speed_before = np.zeros(len(robot.joints))
        self.read(np.zeros(len(robot.joints)))

    def described(self, urdf: str, assets: dict[str, bytes]):
        spec = self.mujoco.MjSpec.from_string(urdf, assets=assets)
        spec.compiler.fusestatic, spec.compiler.discardvisual = True, True
        spec.compiler.boundmass, spec.compiler.boundinertia = MASS_MIN, INERTIA_MIN
        spec.option.timestep = 1 / STEP_HZ
        spec.option.integrator = self.mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        return spec

    def at_home(self, model):
        data = self.mujoco.MjData(model)
        for joint, position in zip(self.robot.joints, self.robot.home):
            data.joint(joint).qpos[0] = position
        self.mujoco.mj_forward(model, data)
        return data

    def overlapping(self, model) -> list[tuple[str, str]]:
        """Neighbours are no matter here: MuJoCo lets bodies touch that one joint connects, except for the fixed base."""
        data = self.at_home(model)
        pairs = {(0, index) for index in range(1, model.nbody) if model.body_parentid[index] == 0}
        for geoms, distance_m in zip(data.contact.geom, data.contact.dist):
            if distance_m < 0:
                pairs.add(tuple(sorted(model.geom_bodyid[geoms].tolist())))
        return [(model.body(first).name, model.body(second).name) for first, second in sorted(pairs)]

    def move(self, command: np.ndarray, period_s: float) -> None:
        data, self.saturated_steps = self.data, 0
        q, v, bias, effort = data.qpos, data.qvel, data.qfrc_bias, self.robot.effort_max
        share, self.contacts = np.zeros(len(command)), {}
        steps = max(1, round(period_s * STEP_HZ))
        speed = self.feed_forward * (command - self.before) / period_s
        # Drives reach a new command and its speed within one update, as in cyclic position mode. It is an assumption.
        targets, speeds = np.linspace(self.before, command, steps + 1), np.linspace(self.speed_before, speed, steps + 1)
        for target, speed in zip(targets[1:], speeds[1:]):
            self.mujoco.mj_step1(self.model, data)
            wanted = self.stiffness * (target - q[self.q_at]) + self.damping * (speed - v[self.v_at]) + bias[self.v_at]
            np.maximum(share, np.abs(wanted) / effort, out=share)
            self.torque = np.minimum(np.maximum(wanted, -effort), effort)
            self.saturated_steps += (wanted != self.torque).any()
            data.qfrc_applied[self.v_at] = self.torque
            self.touch()
            self.mujoco.mj_step2(self.model, data)
        self.before, self.speed_before = command.copy(), speed
        self.saturated_steps = int(self.saturated_steps)
        self.read(np.minimum(share, 1.0))

    def touch(self) -> None:
        """Remembers each checked pair of links that overlap, and how deeply (m)."""
        if self.data.ncon == 0:
            return
        for geoms, distance_m in zip(self.data.contact.geom.tolist(), self.data.contact.dist.tolist()):
            pair = frozenset(self.link[geom] for geom in geoms)
            if distance_m < 0 and pair not in self.allowed:
                name = ", ".join(sorted(pair))
                self.contacts[name] = max(self.contacts.get(name, 0.0), -distance_m)

    def read(self, share: np.ndarray) -> None:
        self.position, self.velocity = self.data.qpos[self.q_at].copy(), self.data.qvel[self.v_at].copy()
        self.torque_share = share

    def picture(self, path: Path) -> None:
        """The shapes that collide, from the front and above, as a PNG without any other library."""
        camera = self.mujoco.MjvCamera()
        camera.lookat, camera.distance, camera.azimuth, camera.elevation = (0.1, 0.0, 0.85), 3.0, 180, -12
        with self.mujoco.Renderer(self.model, 480, 480) as renderer:
            renderer.update_scene(self.data, camera)
            pixels = renderer.render()
        rows = b"".join(b"\0" + row.tobytes() for row in pixels)
        header = struct.pack(">IIBBBBB", pixels.shape[1], pixels.shape[0], 8, 2, 0, 0, 0)
        with path.open("wb") as file:
            file.write(b"\x89PNG\r\n\x1a\n")
            for kind, data in ((b"IHDR", header), (b"IDAT", zlib.compress(rows)), (b"IEND", b"")):
                file.write(struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data)))


def stiffness(joint: str, inertia: float) -> float:
    for group, values in STIFFNESS.items():
        number = joint.removeprefix(group + "_").removesuffix("_joint")
        if joint.startswith(group) and (number.isdigit() or len(values) == 1):
            return values[int(number) - 1 if number.isdigit() else 0]
    return inertia * (2 * math.pi * SERVO_HZ) ** 2


def prepared(robot: Robot, args) -> tuple[str, dict[str, bytes]]:
    """The URDF with collision shapes only, and its meshes. Joints that belong to no controller are locked at zero.

    Without a folder of meshes nothing collides, because shapes that are not meshes may be drawings only.
    """
    root, assets = ElementTree.fromstring(robot.urdf), {}
    for joint in root.findall("joint"):
        if joint.get("name") not in robot.joints:
            joint.set("type", "fixed")
        for extra in joint.findall("mimic") + ([] if args.joint_friction else joint.findall("dynamics")):
            joint.remove(extra)
    for link in root.findall("link"):
        touches = args.meshes and link.get("name") not in args.ignored
        for unused in link.findall("visual") + ([] if touches else link.findall("collision")):
            link.remove(unused)
        if (inertia := link.find("inertial/inertia")) is not None:
            repair(inertia, float(link.find("inertial/mass").get("value")))
        for index, collision in enumerate(link.findall("collision")):
            collision.set("name", f"{link.get('name')}#{index}")
            if (mesh := collision.find("geometry/mesh")) is None:
                continue
            scale = mesh.attrib.pop("scale", "1 1 1")
            path = found(mesh.get("filename"), args.meshes)
            link.remove(collision)
            for number, piece in enumerate(pieces(path, [float(part) for part in scale.split()])):
                name = f"{path.stem}_{len(assets)}.stl"
                assets[name] = piece
                mesh.set("filename", name)
                collision.set("name", f"{link.get('name')}#{index}.{number}")
                link.append(copy.deepcopy(collision))
    return ElementTree.tostring(root, encoding="unicode"), assets


def repair(inertia: ElementTree.Element, mass_kg: float) -> None:
    """Raises the smallest moments until a rigid part can have them: each positive, no two below the third in sum.

    Before that it lowers those of a light part that no such part has.
    """
    keys = (("ixx", "ixy", "ixz"), ("ixy", "iyy", "iyz"), ("ixz", "iyz", "izz"))
    moments, axes = np.linalg.eigh(np.array([[float(inertia.get(key)) for key in row] for row in keys]))
    if mass_kg < LIGHT_KG:
        moments = np.minimum(moments, mass_kg * GYRATION_MAX_M**2)
    moments = np.maximum(moments, INERTIA_MIN)
    # MuJoCo compares exactly, so rounding gets a millionth.
    moments[:2] += max(0.0, moments[2] * (1 + 1e-6) - moments[0] - moments[1]) / 2
    matrix = axes @ np.diag(moments) @ axes.T
    for row, values in zip(keys, matrix):
        for key, value in zip(row, values):
            inertia.set(key, repr(float(value)))


def found(name: str, meshes: Path) -> Path:
    """The file whose path below the folder is the longest end of a name such as `package://robot/meshes/arm/arm_1.dae`."""
    parts = name.split("://")[-1].split("/")
    for first in range(len(parts)):
        path = meshes.joinpath(*parts[first:])
        if path.is_file():
            return path
    raise SystemExit(f"no file in {meshes} for the mesh {name}")


def pieces(path: Path, scale: list[float]) -> list[bytes]:
    """Convex pieces that contain the surface of a mesh together, as STL: slabs along the axis that leaves them the least volume.

    MuJoCo reads no COLLADA, and collides the convex hull of a mesh. The hull of a torso fills its waist.
    """
    import trimesh

    mesh = trimesh.load(path, force="mesh")
    mesh.apply_transform(np.diag([*scale, 1.0]))
    choices = [[trimesh.PointCloud(points).convex_hull for points in slabs(mesh, axis)] for axis in range(3)]
    least = min(choices, key=lambda hulls: sum(hull.volume for hull in hulls))
    found = []
    for hull in least:
        buffer = io.BytesIO()
        hull.export(buffer, file_type="stl")
        found.append(buffer.getvalue())
    return found


def slabs(mesh, axis: int) -> list[np.ndarray]:
    """The corners of a mesh between planes across an axis, and where its edges cross the planes."""
    bounds = np.linspace(*mesh.bounds[:, axis], max(1, round(mesh.extents[axis] / SLAB_M)) + 1)
    ends = mesh.vertices[mesh.edges_unique]
    cuts = []
    for bound in bounds:
        high, low = ends[:, 1, axis] - bound, bound - ends[:, 0, axis]
        crosses = high * low > 0
        share = (low[crosses] / (high + low)[crosses])[:, None]
        cuts.append(ends[crosses, 0] + share * (ends[crosses, 1] - ends[crosses, 0]))
    along = mesh.vertices[:, axis]
    inside = [mesh.vertices[(first <= along) & (along <= last)] for first, last in zip(bounds, bounds[1:])]
    return [np.vstack(points) for points in zip(inside, cuts, cuts[1:])]
