"""An oracle of ros2_controllers' joint_trajectory_controller in Humble. It does no input or output and reads no clock.

It follows the documented behaviour for `command_interfaces: [position]`, `state_interfaces: [position]` and
`open_loop_control: false`. That is the published configuration of the arms of TIAGo++. Times are ns of the robot's clock.
"""

from bisect import bisect_right
from dataclasses import dataclass, field

import numpy as np

NS_PER_S = 1e9
NONE = np.zeros(0)


@dataclass
class Point:
    """One point of a message. An empty array means that the message does not say."""

    time_from_start_ns: int
    positions: np.ndarray
    velocities: np.ndarray = field(default_factory=lambda: NONE)
    accelerations: np.ndarray = field(default_factory=lambda: NONE)
    effort: np.ndarray = field(default_factory=lambda: NONE)


@dataclass
class Message:
    """A JointTrajectory. A stamp of zero means: start at the update that sees it."""

    stamp_ns: int
    joint_names: list[str]
    points: list[Point]


@dataclass
class Reference:
    """The point of a curve at one time."""

    positions: np.ndarray
    velocities: np.ndarray
    accelerations: np.ndarray


def rejection(message: Message, joints: list[str], now_ns: int) -> str | None:
    """Why the controller refuses a message. It accepts a velocity that is not zero at the end, as Humble does."""
    if sorted(message.joint_names) != sorted(joints):
        return "joint names"
    if not message.points:
        return "no points"
    if message.stamp_ns and message.stamp_ns + message.points[-1].time_from_start_ns < now_ns:
        return "ends in the past"
    times = [point.time_from_start_ns for point in message.points]
    if any(later <= earlier for earlier, later in zip(times, times[1:])):
        return "times not increasing"
    count = len(joints)
    for point in message.points:
        if len(point.positions) != count or not {len(point.velocities), len(point.accelerations)} <= {0, count}:
            return "sizes"
        if len(point.effort):
            return "effort"
        # The documentation does not say what happens with this and with NaN, so nobody should rely on it.
        if len(point.accelerations) and not len(point.velocities):
            return "accelerations without velocities"
    if not np.isfinite(np.concatenate([part for p in message.points for part in (p.positions, p.velocities, p.accelerations)])).all():
        return "not finite"
    return None


def polynomial(a: Point, b: Point, duration_s: float) -> np.ndarray:
    """Coefficients, lowest first, of the curve from `a` to `b` over `duration_s`. One column for each joint.

    Linear, cubic or quintic, by what both ends hold. The curve meets the held derivatives at both ends.
    """
    t, step = duration_s, b.positions - a.positions
    if not (len(a.velocities) and len(b.velocities)):
        return np.array([a.positions, step / t])
    v0, v1 = a.velocities, b.velocities
    if not (len(a.accelerations) and len(b.accelerations)):
        return np.array([a.positions, v0, (3 * step / t - 2 * v0 - v1) / t, (v0 + v1 - 2 * step / t) / t**2])
    a0, a1 = a.accelerations, b.accelerations
    # What remains to be met at the end after the terms of `a`, scaled to a duration of 1.
    p, v, q = step - t * v0 - t * t * a0 / 2, t * (v1 - v0 - t * a0), t * t * (a1 - a0)
    return np.array([a.positions, v0, a0 / 2, (10 * p - 4 * v + q / 2) / t**3, (7 * v - 15 * p - q) / t**4,
                     (6 * p - 3 * v + q / 2) / t**5])


def evaluate(coefficients: np.ndarray, t: float) -> Reference:
    """Position, velocity and acceleration at `t`."""
    powers = range(len(coefficients))
    derivatives = ([t**n for n in powers], [n * t ** max(n - 1, 0) for n in powers],
                   [n * (n - 1) * t ** max(n - 2, 0) for n in powers])
    return Reference(*(np.array(derivatives) @ coefficients))


class Curve:
    """One accepted message, from the update at which it replaced the curve before."""

    def __init__(self, message: Message, now_ns: int, measured: np.ndarray):
        first = message.points[0]
        start_ns = message.stamp_ns or now_ns
        # The bridge leaves the measured position with zero velocity, and holds the derivatives that the first point holds.
        before = Point(0, measured.copy(), 0 * first.velocities, 0 * first.accelerations)
        self.points = [before, *message.points]
        self.times_ns = [now_ns, *(start_ns + point.time_from_start_ns for point in message.points)]
        self.segment, self.coefficients = 0, NONE

    def sample(self, now_ns: int) -> tuple[Reference, int]:
        """The reference, and the time since the last point, which is negative before it."""
        since_end_ns = now_ns - self.times_ns[-1]
        if since_end_ns >= 0:
            last = self.points[-1]
            zero = np.zeros(len(last.positions))
            held = (x if len(x) else zero for x in (last.positions, last.velocities, last.accelerations))
            return Reference(*held), since_end_ns
        # The bridge counts only until the time of the first point, which may lie before this update.
        after = bisect_right(self.times_ns, now_ns, lo=1)
        t0, t1 = self.times_ns[after - 1], self.times_ns[after]
        if after != self.segment:
            self.segment = after
            self.coefficients = polynomial(self.points[after - 1], self.points[after], (t1 - t0) / NS_PER_S)
        return evaluate(self.coefficients, (now_ns - t0) / NS_PER_S), since_end_ns


class Controller:
    """One joint_trajectory_controller. `update` stands for one call of the controller manager."""

    def __init__(self, joints: list[str], goal_tolerance: float, goal_time_s: float):
        self.joints = joints
        self.goal_tolerance = goal_tolerance
        self.goal_time_ns = round(goal_time_s * NS_PER_S)
        self.incoming: Message | None = None
        self.curve: Curve | None = None
        self.holding = True
        self.last: Reference | None = None

    def receive(self, message: Message, now_ns: int) -> str | None:
        """Takes a message for the next update, in place of one that still waits. Or it returns why not."""
        reason = rejection(message, self.joints, now_ns)
        if reason is None:
            order = [message.joint_names.index(joint) for joint in self.joints]
            if order != sorted(order):
                message = reordered(message, order)
            self.incoming = message
        return reason

    def update(self, now_ns: int, measured: np.ndarray) -> Reference:
        """The command of this update. `measured` has positions in the order of the controller's joints."""
        if self.incoming is not None:
            self.curve, self.incoming, self.holding = Curve(self.incoming, now_ns, measured), None, False
        if self.curve is None:
            self.hold(now_ns, measured)
        if self.last and now_ns < self.curve.times_ns[0]:
            # The clock jumped back. The curve says nothing yet, so the last command stays.
            return self.last
        reference, since_end_ns = self.curve.sample(now_ns)
        if not self.holding and since_end_ns > self.goal_time_ns:
            if np.abs(reference.positions - measured).max() > self.goal_tolerance:
                # This update keeps the last command. The next one commands the position that is measured now.
                self.hold(now_ns, measured)
                return self.last or reference
        self.last = reference
        return reference

    def hold(self, now_ns: int, measured: np.ndarray) -> None:
        """Holds the measured position, without judging whether it is reached."""
        self.curve, self.holding = Curve(Message(0, self.joints, [Point(0, measured.copy())]), now_ns, measured), True


def reordered(message: Message, order: list[int]) -> Message:
    def pick(values: np.ndarray) -> np.ndarray:
        return values[order] if len(values) else values

    points = [Point(p.time_from_start_ns, pick(p.positions), pick(p.velocities), pick(p.accelerations)) for p in message.points]
    return Message(message.stamp_ns, [message.joint_names[index] for index in order], points)
