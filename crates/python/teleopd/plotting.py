"""Pictures of trajectories. They need matplotlib: `pip install matplotlib`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from . import Trajectory


def plot(trajectory: Trajectory) -> Any:
    """A figure of a trajectory: positions and speeds as shares of their limits, clearance, torque, and the modes.

        >>> import matplotlib; matplotlib.use("Agg")
        >>> import teleopd
        >>> figure = teleopd.plot(teleopd.certify(teleopd.read_motion("builtin")))
        >>> len(figure.axes)
        4
    """
    import matplotlib.pyplot as plt

    from . import MODES

    robot, time_s, limits = trajectory.robot, trajectory.time_s, trajectory.robot.limits
    low, high = limits["position_min"], limits["position_max"]
    figure, rows = plt.subplots(4, sharex=True, figsize=(10, 9), layout="constrained")
    rows[0].plot(time_s, (trajectory.positions - low) / (high - low), linewidth=0.8)
    rows[0].set(ylabel="position, share of range", ylim=(-0.02, 1.02))
    rows[1].plot(time_s, np.abs(trajectory.velocities) / limits["velocity"], linewidth=0.8)
    rows[1].set(ylabel="speed, share of limit", ylim=(0.0, 1.02))
    rows[2].plot(time_s, 1e3 * trajectory.clearance_m)
    rows[2].axhline(1e3 * robot.clearance_min_m, color="red", linestyle=":", label="least allowed")
    rows[2].set(ylabel="clearance, mm")
    rows[2].legend()
    rows[3].plot(time_s, trajectory.torque_share)
    rows[3].set(ylabel="torque, share of limit", xlabel="time, s", ylim=(0.0, 1.0))
    changes = np.flatnonzero(np.diff(trajectory.modes, prepend=255))
    for change in changes:
        rows[3].axvline(time_s[change], color="grey", linewidth=0.5)
        rows[3].annotate(MODES[trajectory.modes[change]], (time_s[change], 0.95), rotation=90, va="top", fontsize=7)
    figure.suptitle(f"{trajectory.name}, {robot.name}")
    return figure
