"""An oracle of ros2_controllers' forward_command_controller with positions. It does no input or output and reads no clock.

It takes the newest message at its next update, and interpolates nothing. It has no timeout: without messages it holds the last
position. A message of another size is ignored. Before the first message it commands nothing, so the joints stay.
"""

from dataclasses import dataclass

import numpy as np


@dataclass
class Reference:
    positions: np.ndarray


class Controller:
    """One forward_command_controller. It has the methods of `trajectory.Controller`."""

    def __init__(self, joints: list[str]):
        self.joints = joints
        self.incoming: np.ndarray | None = None
        self.command: np.ndarray | None = None

    def receive(self, message: np.ndarray, now_ns: int) -> str | None:
        """Takes positions for the next update, in place of those that still wait. Or it returns why not."""
        if len(message) != len(self.joints):
            return "size"
        if not np.isfinite(message).all():
            # The controller would pass it on. No driver should rely on what follows.
            return "not finite"
        self.incoming = message
        return None

    def update(self, now_ns: int, measured: np.ndarray) -> Reference:
        if self.incoming is not None:
            self.command, self.incoming = self.incoming, None
        if self.command is None:
            self.hold(now_ns, measured)
        return Reference(self.command)

    def hold(self, now_ns: int, measured: np.ndarray) -> None:
        self.command, self.incoming = measured.copy(), None
