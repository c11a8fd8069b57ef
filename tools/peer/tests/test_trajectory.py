"""The oracle against each documented behaviour of the controller, and the table of messages that it can follow."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1]))
from trajectory import Controller, Curve, Message, Point, evaluate, polynomial  # noqa: E402

MS = 1_000_000
NOW = 1000 * MS
A = np.array([0.1])


def controller(joints=("a",)):
    # 0.02 rad and 0.6 s: the published configuration of the arms.
    return Controller(list(joints), goal_tolerance=0.02, goal_time_s=0.6)


def message(*points, stamp=0, names=("a",)):
    """Points are (time in ms, position[, velocity[, acceleration]])."""
    parts = [Point(round(t * MS), *(np.full(len(names), x, dtype=float) for x in rest)) for t, *rest in points]
    return Message(stamp, list(names), parts)


def after(points, stamp, measured, since_ms):
    """Position a while after the update that sees the message, while the joint stands still."""
    one = controller()
    one.receive(message(*points, stamp=stamp), NOW)
    one.update(NOW, np.array([measured]))
    return one.update(NOW + since_ms * MS, np.array([measured])).positions[0]


def test_activation_holds_measured():
    assert controller().update(NOW, A).positions == A


def test_zero_stamp_starts_at_the_update_and_bridges_from_measured():
    assert after([(100, 0.3)], 0, 0.1, 50) == pytest.approx(0.2)
    # With a velocity the bridge is cubic and begins at rest: 0.1 + 0.2 (3 s^2 - 2 s^3) at s = 1/4.
    assert after([(100, 0.3, 0.0)], 0, 0.1, 25) == pytest.approx(0.1 + 0.2 * (3 / 16 - 2 / 64))


def test_replacement_forgets_the_old_curve_and_restarts_from_measured():
    one = controller()
    one.receive(message((0, 0.0), (100, 1.0)), NOW)
    assert one.update(NOW, A * 0).positions == 0.0
    assert one.update(NOW + 50 * MS, A * 0).positions == pytest.approx(0.5)
    one.receive(message((100, 1.0)), NOW + 50 * MS)
    assert one.update(NOW + 60 * MS, A).positions == pytest.approx(0.1)


def test_stamp_is_absolute_and_past_points_need_no_bridge():
    points = [(0, 0.0), (100, 1.0)]
    assert after(points, NOW - 40 * MS, 0.7, 0) == pytest.approx(0.4)
    assert after(points, NOW - 40 * MS, 0.7, 10) == pytest.approx(0.5)
    assert after(points, NOW + 40 * MS, 0.2, 20) == pytest.approx(0.1), "half of the bridge from 0.2 to 0"


def test_only_an_end_in_the_past_is_rejected():
    assert controller().receive(message((0, 0.0), (10, 1.0), stamp=NOW - 11 * MS), NOW) == "ends in the past"
    assert controller().receive(message((0, 0.0), (10, 1.0), stamp=NOW - 10 * MS), NOW) is None
    assert controller().receive(message((0, 0.0), (10, 1.0)), NOW) is None


@pytest.mark.parametrize("reason, bad", [
    ("times not increasing", message((0, 0.0), (10, 1.0), (10, 2.0))),
    ("joint names", message((0, 0.0), names=("b",))),
    ("joint names", message((0, 0.0), names=("a", "b"))),
    ("joint names", message((0, 0.0), names=())),
    ("no points", message()),
    ("sizes", Message(0, ["a"], [Point(0, np.zeros(0), np.zeros(1))])),
    ("sizes", Message(0, ["a"], [Point(0, np.zeros(2))])),
    ("sizes", Message(0, ["a"], [Point(0, np.zeros(1), np.zeros(2))])),
    ("effort", Message(0, ["a"], [Point(0, np.zeros(1), effort=np.zeros(1))])),
    ("not finite", message((0, np.nan))),
    ("accelerations without velocities", Message(0, ["a"], [Point(0, np.zeros(1), accelerations=np.zeros(1))])),
])
def test_bad_message_is_rejected_and_changes_nothing(reason, bad):
    one = controller()
    one.receive(message((0, 0.1)), NOW)
    assert one.receive(bad, NOW) == reason
    assert one.update(NOW, A).positions == A


def test_incomplete_names_are_rejected_and_order_is_free():
    one = controller(("a", "b"))
    assert one.receive(message((0, 0.0)), NOW) == "joint names"
    swapped = Message(0, ["b", "a"], [Point(0, np.array([2.0, 1.0]))])
    assert one.receive(swapped, NOW) is None
    assert list(one.update(NOW, np.zeros(2)).positions) == [1.0, 2.0]


def test_first_time_may_be_zero_and_last_velocity_nonzero():
    assert after([(0, 0.0, 1.0), (10, 0.3, 1.0)], 0, 0.3, 500) == 0.3


@pytest.mark.parametrize("degree", [1, 3, 5])
def test_interpolation_meets_a_polynomial_of_its_degree(degree):
    rng = np.random.default_rng(degree)
    true = rng.normal(size=(degree + 1, 3))
    ends = [evaluate(true, t) for t in (0.0, 0.7)]
    held = {1: 1, 3: 2, 5: 3}[degree]
    a, b = (Point(0, *(e.positions, e.velocities, e.accelerations)[:held]) for e in ends)
    assert polynomial(a, b, 0.7) == pytest.approx(true)
    slope = (evaluate(true, 0.3 + 1e-6).velocities - evaluate(true, 0.3 - 1e-6).velocities) / 2e-6
    assert evaluate(true, 0.3).accelerations == pytest.approx(slope, abs=1e-6)


def test_one_end_without_velocities_makes_the_segment_linear():
    curve = Curve(message((0, 0.0), (100, 1.0)), NOW, A)
    curve.points[1].velocities = np.array([5.0])
    # 0.25 lies on the line. A cubic would be elsewhere.
    assert curve.sample(NOW + 25 * MS)[0].positions == pytest.approx(0.25)


def test_clock_that_jumps_back_keeps_the_last_command():
    one = controller()
    one.receive(message((0, 0.0), (100, 1.0)), NOW)
    one.update(NOW, A)
    assert one.update(NOW + 50 * MS, A).positions == pytest.approx(0.5)
    assert one.update(NOW - 500 * MS, A).positions == pytest.approx(0.5)


@pytest.mark.parametrize("error, held", [(0.019, 0.1), (0.021, 0.121)])
def test_goal_missed_for_goal_time_holds_measured(error, held):
    one, measured = controller(), A + error
    one.receive(message((0, 0.1)), NOW)
    for ms in range(0, 610, 10):
        assert one.update(NOW + ms * MS, measured).positions == pytest.approx(0.1), ms
    one.update(NOW + 610 * MS, measured)
    assert one.update(NOW + 620 * MS, measured * 2).positions == pytest.approx(held)


def follow(update_hz, build, lost=lambda index: False):
    """Follows a sine of 0.5 rad at 0.35 Hz for 8 s at 100 messages/s and a delay of 1 ms plus 2 ms on average.

    The joint is a 5 Hz servo. Returns the delay that fits best (ms), what remains then (mrad) and the command's RMS
    acceleration (rad/s^2). An independent model of the controller gave the numbers that the tests compare with.
    """
    rng, one = np.random.default_rng(1), Controller(["a"], 0.02, 0.6)
    omega = 2 * np.pi * 0.35

    def sine(t_ms):
        return 0.5 * np.sin(omega * t_ms / 1e3), 0.5 * omega * np.cos(omega * t_ms / 1e3)

    arrivals = [(k + 1 + rng.exponential(2.0), build(k, sine)) for k in range(0, 8000, 10) if not lost(k // 10)]
    arrivals.sort(key=lambda arrival: arrival[0])
    measured, commands, step_ms = 0.0, [], 1000 // update_hz
    for ms in range(step_ms, 8000, step_ms):
        while arrivals and arrivals[0][0] <= ms:
            one.receive(arrivals.pop(0)[1], NOW + ms * MS)
        command = one.update(NOW + ms * MS, np.array([measured])).positions[0]
        commands.append((ms, command))
        measured += (command - measured) * (1 - np.exp(-2 * np.pi * 5 * step_ms / 1e3))
    t, q = np.array(commands[1000 // step_ms:]).T
    delay = min(range(0, 400), key=lambda d: np.sqrt(np.mean((q - sine(t - d)[0]) ** 2)))
    acceleration = np.diff(q, 2) / (step_ms / 1e3) ** 2
    return delay, 1e3 * np.sqrt(np.mean((q - sine(t - delay)[0]) ** 2)), np.sqrt(np.mean(acceleration**2))


def one_point(ahead_ms):
    return lambda k, sine: message((ahead_ms, *sine(k)))


def four_points_from_now(k, sine):
    return message(*((10 * i, *sine(k + 10 * i)) for i in range(4)))


def stamped(late_ms=0):
    """Five points at 10 ms. The first is 20 ms older than the message, and everything is executed 20 ms later."""
    return lambda k, sine: message(*((10 * i, *sine(k - 20 + 10 * i)) for i in range(5)), stamp=NOW + (k + late_ms) * MS)


@pytest.mark.parametrize("hz", [100, 1000])
@pytest.mark.parametrize("of_ten_lost", [0, 1, 2])
def test_five_stamped_points_follow_exactly(hz, of_ten_lost):
    # Two messages in a row may be lost. With the third, the points end 1 ms before the next message can arrive.
    delay, residual_mrad, acceleration = follow(hz, stamped(), lambda index: index % 10 >= 10 - of_ten_lost)
    assert delay == 20
    assert residual_mrad < 0.05
    assert acceleration == pytest.approx(0.5 * (2 * np.pi * 0.35) ** 2 / np.sqrt(2), rel=0.05)


def test_early_stamp_shortens_the_delay_and_late_stamp_breaks():
    assert follow(100, stamped(-10))[:2] == pytest.approx((10, 0.0), abs=0.05)
    # A first point that is still in the future makes every update bridge from the measured position.
    assert follow(1000, stamped(5))[2] > 1000


def test_four_points_from_now_follow_roughly():
    delay, residual_mrad, acceleration = follow(1000, four_points_from_now)
    assert (delay, residual_mrad, acceleration) == (pytest.approx(4, abs=2), pytest.approx(1.4, rel=0.2), pytest.approx(932, rel=0.1))


def test_one_point_for_each_message_creeps():
    assert follow(1000, one_point(20)) == (pytest.approx(156, abs=5), pytest.approx(33, rel=0.1), pytest.approx(26983, rel=0.05))
    # At 100 Hz nearly every update sees a new message, so the arm does not follow. The sine's own RMS is 354 mrad.
    assert follow(100, one_point(20))[1] > 140
    assert follow(100, one_point(30))[1] > 140


def test_silence_plays_the_tail_to_its_end():
    """A message with a stop as its tail needs no other: the controller stops as the tail says."""
    one = controller()
    # From 1 rad/s to rest at 5 rad/s^2: 200 ms, 0.1 rad.
    tail = [(10 * i, 0.01 * i - 2.5 * (0.01 * i) ** 2, 1 - 0.05 * i) for i in range(21)]
    one.receive(message(*tail, stamp=NOW), NOW)
    q = np.array([one.update(NOW + 10 * i * MS, A * 0).positions[0] for i in range(41)])
    assert np.abs(np.diff(q, 2)).max() / 0.01**2 == pytest.approx(5.0)
    assert q[20:] == pytest.approx(0.1)
