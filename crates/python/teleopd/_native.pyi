"""The native part of the package. `teleopd` checks shapes and units before it calls this."""

from os import PathLike
from typing import Any

from numpy import float32, float64
from numpy.typing import NDArray

class Robot:
    name: str
    joint_names: list[str]
    arms: tuple[list[str], list[str]]
    prismatic: list[bool]
    home: NDArray[float64]
    limits: dict[str, NDArray[float64]]
    clearance_min_m: float
    fingerprint: str
    urdf: str
    capsules: list[tuple[str, int, tuple[list[float], list[float]], float]]
    pairs: list[tuple[int, int]]
    def __init__(self, choice: str, settings: str | PathLike[str]) -> None: ...
    def forward(self, q: NDArray[float64]) -> NDArray[float64]: ...
    def clearance(self, q: NDArray[float64]) -> NDArray[float64]: ...

class Motion:
    name: str
    rate_hz: float
    warnings: list[str]
    positions: NDArray[float32]
    rotations: NDArray[float32] | None
    closure: NDArray[float32]
    def __init__(self, name: str, positions: NDArray[float32], rotations: NDArray[float32] | None, rate_hz: float) -> None: ...

class Retargeter:
    def __init__(self, robot: Robot, refinement_steps: int) -> None: ...
    def retarget(self, motion: Motion, hinges: str, out_hz: float | None) -> NDArray[float64]: ...
    def encode(self, motion: Motion, hinges: str) -> NDArray[float32]: ...
    def decode(self, latents: NDArray[float32]) -> NDArray[float64]: ...

def interpolate(a: NDArray[float32], b: NDArray[float32], share: float) -> NDArray[float32]: ...
def read_motion(
    path: str | PathLike[str], frame_rate_hz: float | None, up: str | None, mirror: bool, files: list[str | PathLike[str] | None]
) -> Motion: ...
def certify(motion: Motion, robot: Robot, hinges: str, rate_hz: int) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]: ...
def read_recording(
    path: str | PathLike[str], rate_hz: float | None
) -> tuple[dict[str, dict[str, NDArray[Any]]], dict[str, str], str | None]: ...
