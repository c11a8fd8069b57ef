"""Faults between the driver and the robot. One seed makes them repeatable."""

import random
import re
from dataclasses import dataclass

#: Kind, and what its value means. `None` means that it takes no value.
KINDS = {
    "late": "ms by which commands arrive later",
    "lost": "probability of each command to be lost",
    "names": None,      # the controller has other joints
    "inactive": None,   # the controller is switched off: it publishes no state and takes no command
    "clock": "s by which the robot's whole clock is ahead",
    "stamps": "s by which the stamps of joint_states are ahead of the robot's clock",
    "velocities": None, # joint_states has NaN for every velocity
    "second": None,     # another program publishes on the controller's command topic
    "stale": None,      # the counter of a Unitree robot's state stands
    "partition": None,  # nothing passes in either direction
    "unwatched": None,  # the publisher of the emergency stop leaves
    "emergency": None,  # somebody pressed the emergency stop: brakes hold the joints
}
SPEC = re.compile(r"(?P<kind>\w+)(=(?P<value>[-\d.]+))?(/(?P<controller>\w+))?(@(?P<at>[\d.]+))?(\+(?P<duration>[\d.]+))?")
GRAMMAR = "KIND[=VALUE][/CONTROLLER][@AT][+DURATION], times in s, for example lost=0.1/head_controller@5+2"


@dataclass
class Fault:
    kind: str
    value: float
    controller: str | None
    begin_s: float
    end_s: float


def parse(spec: str, now_s: float = 0.0) -> Fault:
    """A fault that begins AT after `now_s`, or now, and ends DURATION later, or never."""
    match = SPEC.fullmatch(spec.strip())
    if not match or match["kind"] not in KINDS or (match["value"] is None) != (KINDS[match["kind"]] is None):
        kinds = ", ".join(f"{kind}=({meaning})" if meaning else kind for kind, meaning in KINDS.items())
        raise ValueError(f"no fault: {spec!r}. The form is {GRAMMAR}. The kinds are {kinds}.")
    begin_s = now_s + float(match["at"] or 0)
    return Fault(match["kind"], float(match["value"] or 0), match["controller"], begin_s,
                 begin_s + float(match["duration"] or "inf"))


class Faults:
    def __init__(self, specs: list[str], seed: int):
        self.all = [parse(spec) for spec in specs]
        self.random = random.Random(seed)

    def value(self, kind: str, now_s: float, controller: str | None = None) -> float | None:
        """Sum of the values of the active faults of a kind. `None` if there is none."""
        active = [fault.value for fault in self.all if fault.kind == kind and fault.begin_s <= now_s < fault.end_s
                  and fault.controller in (None, controller)]
        return sum(active) if active else None

    def active(self, kind: str, now_s: float, controller: str | None = None) -> bool:
        return self.value(kind, now_s, controller) is not None

    def delay_s(self, now_s: float, controller: str) -> float | None:
        """How much later a command arrives. `None` if it is lost."""
        lost = self.random.random() < (self.value("lost", now_s, controller) or 0)
        if lost or self.active("partition", now_s):
            return None
        return (self.value("late", now_s, controller) or 0) / 1e3
