"""A robot of a running teleopd, for LeRobot's programs.

    lerobot-record --robot.type=teleopd --teleop.type=teleopd ...      a person leads, LeRobot records
    lerobot-replay --robot.type=teleopd --robot.leads=true ...         LeRobot leads, within the robot's limits

The daemon runs beside it (`teleopd up`), and an operator engages the robot (`teleopctl engage`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from lerobot.robots.config import RobotConfig
from lerobot.robots.robot import Robot

import teleopd
from teleopd import client


@RobotConfig.register_subclass("teleopd")
@dataclass(kw_only=True)
class TeleopdRobotConfig(RobotConfig):
    #: folder of the instance, as `teleopd up --run-dir`
    run_dir: str = client.DEFAULT_RUN_DIR
    #: the instance's robot: a name of the package, or a robot file
    robot: str = "tiago_dual"
    #: actions lead the robot. Without it a person leads, and actions move nothing.
    leads: bool = False
    #: rate of the actions, Hz
    rate_hz: float = 30.0


class TeleopdRobot(Robot):
    """The robot's joints: `NAME.pos`, rad or m. Observations are measured, and actions are asked for.

    Every executed command is within the limits, certified, and checked by the gate.
    """

    config_class = TeleopdRobotConfig
    name = "teleopd"

    def __init__(self, config: TeleopdRobotConfig) -> None:
        super().__init__(config)
        self.config = config
        # `lerobot-record` 0.6.1 counts them, though the base class has none.
        self.cameras: dict[str, Any] = {}
        self._names = [f"{joint}.pos" for joint in teleopd.Robot(config.robot).joint_names]
        self._policy: client.Policy | None = None

    @property
    def observation_features(self) -> dict[str, type]:
        return dict.fromkeys(self._names, float)

    @property
    def action_features(self) -> dict[str, type]:
        return dict.fromkeys(self._names, float)

    @property
    def is_connected(self) -> bool:
        return self._policy is not None

    @property
    def is_calibrated(self) -> bool:
        return True

    def connect(self, calibrate: bool = True) -> None:
        policy = client.Policy(self.config.run_dir)
        there = [f"{joint}.pos" for joint in policy.names]
        if there != self._names:
            policy.close()
            raise ValueError(f"robot = {self.config.robot}: the robot of {self.config.run_dir} is another one, with {len(there)} joints; "
                             "give its name or robot file")
        policy.observe(10.0)
        self._policy = policy

    def calibrate(self) -> None:
        pass

    def configure(self) -> None:
        pass

    def get_observation(self) -> dict[str, Any]:
        joints = self._connected().observe()
        return {name: joints.measured[j] for j, name in enumerate(self._names)}

    def send_action(self, action: dict[str, Any]) -> dict[str, Any]:
        """Asks for an action. Answers it, or without `leads` what is executed."""
        policy = self._connected()
        if not self.config.leads:
            joints = policy.observe()
            return {name: joints.commanded[j] for j, name in enumerate(self._names)}
        policy.publish([[float(action[name]) for name in self._names]], rate_hz=self.config.rate_hz)
        return action

    def _connected(self) -> client.Policy:
        if self._policy is None:
            raise ConnectionError("not connected: call connect()")
        return self._policy

    def disconnect(self) -> None:
        policy, self._policy = self._policy, None
        if policy is not None:
            policy.close()
