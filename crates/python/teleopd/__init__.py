"""Turns the motions of a person into motions of a robot with two arms.

    >>> import teleopd
    >>> robot = teleopd.Robot("tiago_dual")
    >>> motion = teleopd.read_motion("builtin")
    >>> teleopd.Retargeter(robot).retarget(motion).shape
    (1314, 17)

Positions are in metres, x forward, y left, z up, and angles in radians. A frame of a person is SMPL-22: 22 joints. The order of a
robot's joints is `Robot.joint_names`. Wrong arguments raise ValueError, and files that cannot be read raise OSError.
"""

from __future__ import annotations

import importlib
import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _native

__all__ = [
    "MODES", "Motion", "Recording", "Retargeter", "Robot", "Session", "Trajectory", "certify", "interpolate", "plot",
    "read_motion", "read_recording",
]

#: modules that are imported on first use
_MODULES = ("datasets", "lerobot", "mjcf", "ray")

#: names of a trajectory's modes, by number
MODES = ("Disengaged", "Engaging", "Engaged", "Holding", "Faulted", "Recovering")

#: Largest distance of a joint from the origin, m. Cameras and suits see less. It finds other units.
POSITION_MAX_M = 1e3
#: Largest deviation of a quaternion's norm from 1. It is above the rounding of a 16-bit float, and below any error of units.
NORM_TOLERANCE = 1e-2


def _settings() -> Path:
    """The settings that come with the package: beside `bin` of an installation, or in the repository."""
    places = [folder / place for folder in Path(__file__).resolve().parents
              for place in ("share/teleopd/teleop.toml", "config/teleop.toml")]
    for place in places:
        if place.is_file():
            return place
    raise FileNotFoundError(f"{__file__}: no share/teleopd/teleop.toml in a folder above: install the wheel again, or give settings")


def _array(name: str, value: ArrayLike, row: tuple[int, ...], dtype: type, unit: str) -> tuple[NDArray[Any], bool]:
    """`value` as contiguous rows of this shape, and whether it was a single row."""
    try:
        array: NDArray[Any] = np.ascontiguousarray(value, dtype=dtype)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name}: not an array of numbers: {error}") from None
    single = array.shape == row
    if single:
        array = array[np.newaxis]
    if array.ndim != len(row) + 1 or array.shape[1:] != row or not len(array):
        sizes = ", ".join(map(str, row))
        raise ValueError(f"{name}: shape {np.shape(value)}, ({sizes}) or (N, {sizes}) expected, {unit}")
    return array, single


class Robot:
    """A robot with its settings and weights.

    name: one of the package's robots, such as "tiago_dual", or a robot file. settings: a settings file in place of the package's.

        >>> robot = Robot("tiago_dual")
        >>> len(robot.joint_names), robot.joint_names[3]
        (17, 'arm_left_1_joint')
        >>> robot.limits["velocity"].shape
        (17,)
    """

    def __init__(self, name: str | os.PathLike[str] = "tiago_dual", settings: str | os.PathLike[str] | None = None) -> None:
        self._choice = os.fspath(name)
        self._native = _native.Robot(self._choice, os.fspath(settings or _settings()))
        #: name of the robot
        self.name: str = self._native.name
        #: names of the joints, in the order of every array
        self.joint_names: list[str] = self._native.joint_names
        left, right = self._native.arms
        #: names of the joints of the left and of the right arm
        self.arms: tuple[list[str], list[str]] = (left, right)
        #: "m" for joints that slide, "rad" for joints that turn
        self.units: list[str] = ["m" if slides else "rad" for slides in self._native.prismatic]
        #: limits in force, an array each: position_min, position_max, velocity, acceleration, jerk, effort; rad or m, s, N m or N
        self.limits: dict[str, NDArray[np.float64]] = self._native.limits
        #: home posture
        self.home: NDArray[np.float64] = self._native.home
        #: least clearance of a command, m
        self.clearance_min_m: float = self._native.clearance_min_m

    def __repr__(self) -> str:
        return f"Robot({self._choice!r})"

    def _rows(self, q: ArrayLike) -> tuple[NDArray[np.float64], bool]:
        rows, single = _array("q", q, (len(self.joint_names),), np.float64, "rad or m")
        for row, joint in np.argwhere(~np.isfinite(rows))[:1]:
            raise ValueError(f"q: row {row}, {self.joint_names[joint]} = {rows[row, joint]}: must be finite, rad or m")
        return rows, single

    def forward(self, q: ArrayLike) -> NDArray[np.float64]:
        """Poses of the bodies in the base frame, (joints + 1, 4, 4) or (N, joints + 1, 4, 4).

        Body 0 is the base, and body 1 + j moves with joint j. q: (joints,) or (N, joints), rad or m.

            >>> robot = Robot()
            >>> hand = robot.forward(robot.home)[1 + robot.joint_names.index("arm_left_7_joint")]
            >>> hand[:3, 3].round(2).tolist()
            [0.35, 0.47, 0.67]
        """
        rows, single = self._rows(q)
        poses = self._native.forward(rows)
        return poses[0] if single else poses

    def clearance(self, q: ArrayLike) -> NDArray[np.float64]:
        """Smallest clearance of the checked pairs of parts and of the obstacles, m, () or (N,).

            >>> robot = Robot()
            >>> bool(robot.clearance(robot.home) >= robot.clearance_min_m)
            True
        """
        rows, single = self._rows(q)
        clearances = self._native.clearance(rows)
        return clearances[0] if single else clearances


class Motion:
    """A motion of one person, from arrays. `read_motion` reads one from a file.

    positions: (N, 22, 3), m. rotations: (N, 22, 4), x y z w, or None. rate_hz: frames per second.

        >>> import numpy as np
        >>> standing = read_motion("builtin").positions[0]
        >>> Motion(np.stack([standing] * 30), rate_hz=30).duration_s
        1.0
    """

    def __init__(self, positions: ArrayLike, rotations: ArrayLike | None = None, rate_hz: float = 60.0, name: str = "array") -> None:
        rows, _ = _array("positions", positions, (22, 3), np.float32, "m")
        # NaN is outside, too.
        for frame, joint in np.argwhere(~np.all(np.abs(rows) <= POSITION_MAX_M, axis=2))[:1]:
            bound = f"must be within {POSITION_MAX_M:.0f} m of the origin"
            raise ValueError(f"positions[{frame}, {joint}] = {rows[frame, joint].tolist()}: {bound}")
        turns = None
        if rotations is not None:
            turns, _ = _array("rotations", rotations, (22, 4), np.float32, "x y z w")
            if len(turns) != len(rows):
                raise ValueError(f"rotations: {len(turns)} frames, positions: {len(rows)}")
            for frame, joint in np.argwhere(~(np.abs(np.linalg.norm(turns, axis=2) - 1.0) <= NORM_TOLERANCE))[:1]:
                raise ValueError(f"rotations[{frame}, {joint}] = {turns[frame, joint].tolist()}: must be a unit quaternion x y z w")
        self._native = _native.Motion(name, rows, turns, float(rate_hz))

    @classmethod
    def _of(cls, native: _native.Motion) -> Motion:
        motion = cls.__new__(cls)
        motion._native = native
        return motion

    @property
    def name(self) -> str:
        """Name of the file, or of the built-in motion."""
        return self._native.name

    @property
    def rate_hz(self) -> float:
        """Frames per second."""
        return self._native.rate_hz

    @property
    def positions(self) -> NDArray[np.float32]:
        """Global positions, (N, 22, 3), m."""
        return self._native.positions

    @property
    def rotations(self) -> NDArray[np.float32] | None:
        """Global rotations, (N, 22, 4), x y z w. None if the source has none."""
        return self._native.rotations

    @property
    def closure(self) -> NDArray[np.float32]:
        """Closure of the left and of the right hand, (N, 2), 0 (open) to 1 (closed). NaN where it is not known."""
        return self._native.closure

    @property
    def warnings(self) -> list[str]:
        """What the reader guessed or lost, a sentence each."""
        return self._native.warnings

    @property
    def duration_s(self) -> float:
        """Length, s."""
        return len(self) / self.rate_hz

    def __len__(self) -> int:
        return len(self._native.closure)


def _motion(positions: Motion | ArrayLike, rotations: ArrayLike | None, rate_hz: float | None) -> tuple[Motion, bool]:
    """A motion, and whether it was given as a single frame."""
    if isinstance(positions, Motion):
        if rotations is not None or rate_hz is not None:
            raise ValueError("rotations, rate_hz: a Motion has its own; leave them out")
        return positions, False
    return Motion(positions, rotations, 60.0 if rate_hz is None else rate_hz), np.ndim(positions) == 2


class Retargeter:
    """Turns frames of a person into postures of a robot, as `replay batch` does, bit for bit.

    They are postures, not a motion: they know no limit of speed and no clearance. `certify` makes what a robot may play.
    refinement_steps: Levenberg-Marquardt steps after the network.

        >>> motion = read_motion("builtin")
        >>> retargeter = Retargeter(Robot())
        >>> retargeter.retarget(motion.positions, motion.rotations, rate_hz=60).shape
        (1314, 17)
        >>> retargeter.retarget(motion.positions[0]).shape
        (17,)
    """

    def __init__(self, robot: Robot, refinement_steps: int = 2) -> None:
        self.robot = robot
        self._native = _native.Retargeter(robot._native, refinement_steps)

    def retarget(
        self, positions: Motion | ArrayLike, rotations: ArrayLike | None = None, rate_hz: float | None = None, *,
        out_hz: float | None = None, calibration: str = "clip",
    ) -> NDArray[np.float64]:
        """Postures, (N, joints) or (joints,), rad or m.

        positions: a Motion, (N, 22, 3) or (22, 3), m. rotations: (N, 22, 4) or (22, 4), x y z w: without them the twist of the limbs
        is unknown. rate_hz: frames per second of the arrays, 60 by default. out_hz: postures per second, by default one for each
        frame. calibration: source of the elbow hinges, "clip", "first-10s", "none" or "rig".

            >>> motion = read_motion("builtin")
            >>> Retargeter(Robot()).retarget(motion, out_hz=1500).shape
            (32826, 17)
        """
        motion, single = _motion(positions, rotations, rate_hz)
        if out_hz is not None and not 1.0 <= out_hz <= 15000.0:
            raise ValueError(f"out_hz = {out_hz}: must be within [1, 15000] Hz")
        q = self._native.retarget(motion._native, calibration, out_hz)
        return q[0] if single else q

    def encode(
        self, positions: Motion | ArrayLike, rotations: ArrayLike | None = None, rate_hz: float | None = None, *,
        calibration: str = "clip",
    ) -> NDArray[np.float32]:
        """Points of the latent space for the left and the right arm, (N, 2, 8) or (2, 8).

            >>> Retargeter(Robot()).encode(read_motion("builtin")).shape
            (1314, 2, 8)
        """
        motion, single = _motion(positions, rotations, rate_hz)
        latents = self._native.encode(motion._native, calibration)
        return latents[0] if single else latents

    def decode(self, latents: ArrayLike) -> NDArray[np.float64]:
        """Postures of points of the latent space, without refinement, (N, joints) or (joints,), rad or m.

            >>> retargeter = Retargeter(Robot())
            >>> first, last = retargeter.encode(read_motion("builtin"))[[0, 400]]
            >>> retargeter.decode(interpolate(first, last, 0.5)).shape
            (17,)
        """
        rows, single = _array("latents", latents, (2, 8), np.float32, "no unit")
        q = self._native.decode(rows)
        return q[0] if single else q


def interpolate(a: ArrayLike, b: ArrayLike, share: float) -> NDArray[np.float32]:
    """Points on the straight lines of the latent space from `a` (share 0) to `b` (share 1), in the shape of `a`, (..., 8).

        >>> interpolate([0.0] * 8, [1.0] * 8, 0.25).tolist()[:2]
        [0.25, 0.25]
    """
    first, last = np.ascontiguousarray(a, dtype=np.float32), np.ascontiguousarray(b, dtype=np.float32)
    if first.shape != last.shape or first.shape[-1:] != (8,):
        raise ValueError(f"a, b: shapes {first.shape} and {last.shape}, the same (..., 8) expected")
    return _native.interpolate(first.reshape(-1, 8), last.reshape(-1, 8), float(share)).reshape(first.shape)


@dataclass(frozen=True)
class Trajectory:
    """A motion that the robot may play: every command was certified, and let through by the gate."""

    #: name of the motion
    name: str
    #: the robot
    robot: Robot
    #: rows per second
    rate_hz: float
    #: time since the enable, (N,), s
    time_s: NDArray[np.float64]
    #: commanded positions, (N, joints), rad or m
    positions: NDArray[np.float64]
    #: commanded velocities, (N, joints), rad/s or m/s
    velocities: NDArray[np.float64]
    #: what the person asked for, (N, joints), rad or m
    targets: NDArray[np.float64]
    #: number of the mode, (N,), see MODES
    modes: NDArray[np.uint8]
    #: smallest clearance, (N,), m
    clearance_m: NDArray[np.float64]
    #: largest ratio of a torque to its joint's effort limit, (N,)
    torque_share: NDArray[np.float64]
    #: newest frame of the motion at each row, (N,); -1 before the motion begins. The robot follows it with a delay.
    frames: NDArray[np.int64]
    #: figures of all 1500 ticks a second: ticks, min_clearance_mm, torque_share_max, limb_error_deg_mean, violations
    report: dict[str, Any] = field(repr=False)

    def __len__(self) -> int:
        return len(self.time_s)


def certify(
    motion: Motion | ArrayLike, robot: Robot | str = "tiago_dual", settings: str | os.PathLike[str] | None = None, rate_hz: int = 100, *,
    source_hz: float | None = None, calibration: str = "clip",
) -> Trajectory:
    """The trajectory that the robot would play: the stages of `replay --offline` and `replay batch --certified`, row by row.

    motion: a Motion, or positions (N, 22, 3), m, at source_hz frames per second (60 by default). settings: a settings file in place of
    the robot's. rate_hz: rows per second, a divisor of 1500. Raises ValueError if the robot was stopped, did not engage, or broke a
    limit.

        >>> trajectory = certify(read_motion("builtin"), "tiago_dual")
        >>> trajectory.positions.shape[1], trajectory.report["violations"]["velocity"]
        (17, 0)
        >>> bool(trajectory.clearance_m.min() >= trajectory.robot.clearance_min_m)
        True
    """
    person, _ = _motion(motion, None, source_hz)
    if not isinstance(robot, Robot) or settings is not None:
        robot = Robot(robot._choice if isinstance(robot, Robot) else robot, settings)
    columns, report = _native.certify(person._native, robot._native, calibration, rate_hz)
    time_s = columns.pop("k") / 1500.0
    return Trajectory(name=person.name, robot=robot, rate_hz=float(rate_hz), time_s=time_s, report=report, **columns)


def read_motion(
    path: str | os.PathLike[str], *, frame_rate_hz: float | None = None, up: str | None = None, mirror: bool = False,
    mean: str | os.PathLike[str] | None = None, std: str | os.PathLike[str] | None = None,
    map: str | os.PathLike[str] | None = None,
) -> Motion:
    """The motion of a file that `replay` reads: .bvh, .npy (HumanML3D), .npz (AMASS), .mcap; or "builtin", "pick-and-place".

    frame_rate_hz: in place of the file's. up: "y" or "z", the axis that points up in an array. mirror: mirrors the person back.
    mean, std: files of the statistics of normalised features. map: a TOML file with names of joints. They are the options of `replay`.

        >>> motion = read_motion("builtin")
        >>> motion.positions.shape, motion.rate_hz
        ((1314, 22, 3), 60.0)
    """
    return Motion._of(_native.read_motion(os.fspath(path), frame_rate_hz, up, mirror, [mean, std, map]))


@dataclass(frozen=True)
class Recording:
    """The messages of a recording as arrays.

    messages: by kind (skeletons, targets, policy_targets, commands, states, statuses) a table of columns with one row for each message. Each has
    `time_ns`. about: what the recorder knows of the run, such as the robot. lost: a sentence on damage, or None.
    """

    messages: dict[str, dict[str, NDArray[Any]]] = field(repr=False)
    about: dict[str, str]
    lost: str | None


def read_recording(path: str | os.PathLike[str], *, rate_hz: float | None = None) -> Recording:
    """The messages of a recording of `record`, `demo --record` or `replay --record`. rate_hz: keeps the first message of a kind in
    each period of this rate; the periods begin with the clock of the file.

        >>> read_recording("none.mcap")
        Traceback (most recent call last):
        OSError: none.mcap: there is no such file. Check the path; it is relative to the current folder
    """
    return Recording(*_native.read_recording(os.fspath(path), rate_hz))


def __getattr__(name: str) -> Any:
    # They are imported on first use, because most need another package.
    if name in _MODULES:
        return importlib.import_module(f"teleopd.{name}")
    try:
        if name == "Session":
            from .session import Session
            return Session
        if name == "plot":
            import matplotlib.pyplot  # noqa: F401

            from .plotting import plot
            return plot
    except ModuleNotFoundError as error:
        packages = {"iceoryx2": "iceoryx2==0.10.0", "matplotlib": "matplotlib"}
        if error.name not in packages:
            raise
        raise ModuleNotFoundError(f"teleopd.{name} needs {error.name}: pip install {packages[error.name]}", name=error.name) from None
    raise AttributeError(f"module 'teleopd' has no attribute {name!r}")
