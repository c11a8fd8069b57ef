"""The person before a running teleopd, as a teleoperator of LeRobot's programs.

    lerobot-record --robot.type=teleopd --teleop.type=teleopd ...

Its action is what the robot was commanded: the person's motion within limits, certified and checked by the gate. With the robot of the type
`teleopd` nothing is sent a second time.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

from lerobot.teleoperators.config import TeleoperatorConfig
from lerobot.teleoperators.teleoperator import Teleoperator

import teleopd
from teleopd import client


@TeleoperatorConfig.register_subclass("teleopd")
@dataclass(kw_only=True)
class TeleopdTeleoperatorConfig(TeleoperatorConfig):
    #: folder of the instance, as `teleopd up --run-dir`
    run_dir: str = client.DEFAULT_RUN_DIR
    #: the instance's robot: a name of the package, or a robot file
    robot: str = "tiago_dual"


class TeleopdTeleoperator(Teleoperator):
    """The commanded joints: `NAME.pos`, rad or m."""

    config_class = TeleopdTeleoperatorConfig
    name = "teleopd"

    def __init__(self, config: TeleopdTeleoperatorConfig) -> None:
        super().__init__(config)
        self.config = config
        self._names = [f"{joint}.pos" for joint in teleopd.Robot(config.robot).joint_names]
        self._reader: client.JointsReader | None = None
        self._newest: client.Joints | None = None

    @property
    def action_features(self) -> dict[str, type]:
        return dict.fromkeys(self._names, float)

    @property
    def feedback_features(self) -> dict[str, type]:
        return {}

    @property
    def is_connected(self) -> bool:
        return self._reader is not None

    @property
    def is_calibrated(self) -> bool:
        return True

    def connect(self, calibrate: bool = True) -> None:
        self._reader = client.JointsReader(self.config.run_dir)

    def calibrate(self) -> None:
        pass

    def configure(self) -> None:
        pass

    def get_action(self) -> dict[str, Any]:
        if self._reader is None:
            raise ConnectionError("not connected: call connect()")
        give_up = time.monotonic() + 2.0
        while (newest := self._reader.latest() or self._newest) is None:
            if time.monotonic() > give_up:
                raise client.TeleopdError("no joints came: does the driver run, and does it measure?")
            time.sleep(0.002)
        self._newest = newest
        return {name: newest.commanded[j] for j, name in enumerate(self._names)}

    def send_feedback(self, feedback: dict[str, Any]) -> None:
        pass

    def disconnect(self) -> None:
        reader, self._reader = self._reader, None
        if reader is not None:
            reader.close()
