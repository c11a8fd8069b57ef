"""Times one tick of placo's inverse kinematics beside one tick of our control on the same robot file.

    python3 -m venv /tmp/placo && /tmp/placo/bin/pip install -r tools/torture/requirements.txt
    cargo build --release -p torture --example control_tick
    /tmp/placo/bin/python tools/torture/bench_placo.py [--rounds 7] [--ticks 20000] [--pairs 22]
    [--binary TARGET/release/examples/control_tick]...

Releases of placo differ, so only the version in `requirements.txt` is accepted, and it is printed.
placo: the 17 joints' task with joint limits, velocity limits and avoidance of self-collision over the nearest pairs of
the robot file's capsules (its cylinders have the same ends and radii), one quadratic program per tick. It keeps first
order limits of this instant: no acceleration, no jerk, no stop plan and no gate, and it checks 22 pairs.
Ours: whole-body control and the gate, all checked pairs (`tools/torture/examples/control_tick.rs`). `--binary` may be given
more than once, to compare builds.
All follow the same sines about the home posture. They run in turns. Each round gives a time of each program and the ratio
of both. The medians over the rounds are printed. Other load changes the times more than the ratios.
"""

import argparse
import importlib.metadata
import json
import math
import statistics
import subprocess
import tempfile
import time
import tomllib
import xml.etree.ElementTree as xml
from pathlib import Path

import numpy
import pinocchio
import placo

ROOT = Path(__file__).resolve().parents[2]
RATE_HZ = 1500
# The same as in `examples/control_tick.rs`.
WAVE_RAD = 0.2
WARM_TICKS = 2000
REQUIREMENTS = Path(__file__).with_name("requirements.txt")


def placo_version() -> str:
    """The installed version of placo. Exits if `requirements.txt` pins another one."""
    version = importlib.metadata.version("placo")
    if f"placo=={version}" not in REQUIREMENTS.read_text().splitlines():
        raise SystemExit(f"placo {version} is installed: pip install -r {REQUIREMENTS}")
    return version


def commanded_joints(robot: dict) -> list:
    """The commanded joints of a robot file (format 2) in the order of messages: body, left arm, right arm. The file
    names a body joint after those above it."""
    arms = robot["arms"]
    return [*robot["body_joints"], *arms["left"]["joints"], *arms["right"]["joints"]]


def capsule_urdf(urdf: Path, robot: dict) -> tuple[str, dict]:
    """The URDF with the capsules of the robot file instead of its collision elements, and the name of each of them in
    pinocchio's geometry: link, underscore, index."""
    tree = xml.parse(urdf)
    links = {link.get("name"): link for link in tree.getroot().findall("link")}
    counts = dict.fromkeys(links, 0)
    names = {}
    for link in links.values():
        for old in link.findall("collision"):
            link.remove(old)
        for old in link.findall("visual"):
            link.remove(old)
    for capsule in robot["collision"]["capsules"]:
        a, b = numpy.array(capsule["a_m"]), numpy.array(capsule["b_m"])
        middle, along = (a + b) / 2, b - a
        length = float(numpy.linalg.norm(along))
        x, y, z = along / length if length > 0 else (0.0, 0.0, 1.0)
        # Rz(yaw) Ry(pitch) takes z to the axis.
        pitch, yaw = math.atan2(math.hypot(x, y), z), math.atan2(y, x)
        link = capsule["link"]
        collision = xml.SubElement(links[link], "collision")
        origin = " ".join(map(str, middle))
        xml.SubElement(collision, "origin", xyz=origin, rpy=f"0 {pitch} {yaw}")
        geometry = xml.SubElement(collision, "geometry")
        xml.SubElement(geometry, "cylinder", radius=str(capsule["radius_m"]), length=str(max(length, 1e-3)))
        names[capsule["name"]] = f"{link}_{counts[link]}"
        counts[link] += 1
    return xml.tostring(tree.getroot(), encoding="unicode"), names


def nearest_pairs(text: str, robot: dict, names: dict, home: dict, count: int) -> list:
    """The checked pairs that are nearest at the home posture, as pinocchio's indices: placo takes names of links only, and
    then all pairs of two links."""
    model = pinocchio.buildModelFromXML(text)
    geometry = pinocchio.buildGeomFromUrdfString(model, text, pinocchio.GeometryType.COLLISION)
    allowed = {
        frozenset((first, second))
        for table in robot["collision"]["allowed"].values()
        for first, others in table.items()
        for second in others
    }
    capsules = [capsule["name"] for capsule in robot["collision"]["capsules"]]
    parent = {name: geometry.geometryObjects[geometry.getGeometryId(names[name])].parentJoint for name in capsules}
    pairs = [
        (first, second)
        for i, first in enumerate(capsules)
        for second in capsules[:i]
        if frozenset((first, second)) not in allowed and parent[first] != parent[second]
    ]
    for first, second in pairs:
        ids = [geometry.getGeometryId(names[name]) for name in (first, second)]
        geometry.addCollisionPair(pinocchio.CollisionPair(*ids))
    q = pinocchio.neutral(model)
    for joint, value in home.items():
        q[model.joints[model.getJointId(joint)].idx_q] = value
    data, geometry_data = model.createData(), geometry.createData()
    pinocchio.computeDistances(model, data, geometry, geometry_data, q)
    distances = [result.min_distance for result in geometry_data.distanceResults]
    order = sorted(range(len(pairs)), key=distances.__getitem__)
    return [[geometry.getGeometryId(names[name]) for name in pairs[i]] for i in order[:count]]


def wave(home: dict, names: list, t: float) -> dict:
    """q = home + s sin(w t), w = 1 + j / 10 rad/s."""
    size = [0.01 * WAVE_RAD] + [WAVE_RAD] * (len(names) - 1)
    return {name: home[name] + size[j] * math.sin((1 + 0.1 * j) * t) for j, name in enumerate(names)}


class Placo:
    """placo's solver on the robot, set up once."""

    def __init__(self, robot_file: Path, pairs: int):
        robot = tomllib.loads(robot_file.read_text())
        urdf = robot_file.parent / robot["urdf"]
        self.names = commanded_joints(robot)
        self.home = {**robot.get("home_m", {}), **robot["home_rad"]}
        text, geometry = capsule_urdf(urdf, robot)
        chosen = nearest_pairs(text, robot, geometry, self.home, pairs)
        with tempfile.TemporaryDirectory() as folder:
            Path(folder, "robot.urdf").write_text(text)
            Path(folder, "collisions.json").write_text(json.dumps(chosen))
            self.robot = placo.RobotWrapper(folder, 0, text)
            self.robot.load_collision_pairs(str(Path(folder, "collisions.json")))
        for name, value in self.home.items():
            self.robot.set_joint(name, value)
        self.robot.update_kinematics()
        self.solver = placo.KinematicsSolver(self.robot)
        self.solver.dt = 1.0 / RATE_HZ
        self.solver.mask_fbase(True)
        self.solver.enable_joint_limits(True)
        self.solver.enable_velocity_limits(True)
        self.joints = self.solver.add_joints_task()
        self.joints.set_joints(self.home)
        self.joints.configure("joints", "soft", 1.0)
        avoid = self.solver.add_avoid_self_collisions_constraint()
        avoid.self_collisions_margin = robot["collision"]["clearance_min_mm"] * 1e-3
        avoid.self_collisions_trigger = 0.1
        avoid.configure("avoid", "hard")
        found = len(self.robot.distances())
        if found != len(chosen):
            raise SystemExit(f"placo watches {found} pairs, {len(chosen)} were meant")
        self.pairs = found

    def durations_us(self, ticks: int) -> list:
        durations = []
        for k in range(ticks + WARM_TICKS):
            self.joints.set_joints(wave(self.home, self.names, k / RATE_HZ))
            begun = time.perf_counter_ns()
            self.solver.solve(True)
            self.robot.update_kinematics()
            durations.append((time.perf_counter_ns() - begun) * 1e-3)
        return durations[WARM_TICKS:]


def ours_us(binary: Path, robot_file: Path, ticks: int) -> dict:
    command = [binary, "--ticks", str(ticks), "--robot", str(robot_file)]
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
    return json.loads(done.stdout)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--ticks", type=int, default=20_000)
    parser.add_argument("--pairs", type=int, default=22)
    parser.add_argument("--robot", type=Path, default=ROOT / "config/robots/tiago_dual.toml")
    parser.add_argument("--binary", type=Path, action="append")
    options = parser.parse_args()
    binaries = options.binary or [ROOT / "target/release/examples/control_tick"]
    for binary in binaries:
        if not binary.exists():
            raise SystemExit(f"{binary}: build it with `cargo build --release -p torture --example control_tick`")
    version = placo_version()
    theirs = Placo(options.robot, options.pairs)
    placo, ours = [], {binary: [] for binary in binaries}
    for _ in range(options.rounds):
        cut = statistics.quantiles(theirs.durations_us(options.ticks), n=100)
        placo.append({"p50": cut[49], "p99": cut[98]})
        for binary in binaries:
            ours[binary].append(ours_us(binary, options.robot, options.ticks))

    def line(name: str, rounds: list) -> str:
        p50, p99 = (statistics.median(round[share] for round in rounds) for share in ("p50", "p99"))
        ratio = statistics.median(round["p50"] / peer["p50"] for round, peer in zip(rounds, placo))
        return f"{name:<34} p50 {p50:6.1f}  p99 {p99:7.1f} us  p50 over placo's {ratio:.2f}"

    print(f"medians of {options.rounds} rounds of {options.ticks} ticks, in turns")
    print(line(f"placo {version}: {theirs.pairs} pairs", placo))
    for binary, rounds in ours.items():
        named = f", {binary}" if len(binaries) > 1 else ""
        for kind in ("smooth", "jumps", "attack"):
            print(line(f"ours: {rounds[0]['pairs']} pairs, {kind}", [round[f"{kind}_us"] for round in rounds]) + named)


main()
