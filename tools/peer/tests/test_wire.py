"""The peer as a process, and a client that streams trajectories to it over DDS on the loopback interface."""

import csv
import json
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

PEER = Path(__file__).parents[1]
sys.path.insert(0, str(PEER))
pytest.importorskip("cyclonedds")
import messages as m  # noqa: E402
from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication  # noqa: E402
from cyclonedds.domain import Domain, DomainParticipant  # noqa: E402
from cyclonedds.pub import DataWriter  # noqa: E402
from cyclonedds.sub import DataReader  # noqa: E402
from cyclonedds.topic import Topic  # noqa: E402
from faults import parse  # noqa: E402
from hands import described  # noqa: E402
from robot import load  # noqa: E402

ROBOT = load(PEER.parents[1] / "config/robots/tiago_dual.toml", None)
#: Folder with the manufacturer's URDF and its meshes, for the test of the body.
DESCRIPTION = os.environ.get("PEER_DESCRIPTION")
DOMAIN = 100 + os.getpid() % 100
#: How far behind the client the robot executes.
DELAY_S = 0.02
#: A machine that keeps the client or the peer for longer than this was no robot. A message holds for 40 ms.
LATE_MAX_S = 0.015
#: Runs of a measurement at most, until nobody was late in one.
RUNS = 5
CONFIGURATION = '<CycloneDDS><Domain><General><Interfaces><NetworkInterface name="lo" multicast="true"/></Interfaces></General></Domain></CycloneDDS>'


class Client:
    domain = None

    def __init__(self):
        Client.domain = Client.domain or Domain(DOMAIN, CONFIGURATION)
        self.participant = DomainParticipant(DOMAIN)
        self.commands = {name: DataWriter(self.participant, self.topic(f"{name}/joint_trajectory", m.JointTrajectory), m.WRITER)
                         for name in ROBOT.controllers}
        self.joint_states = self.reader("joint_states", m.JointState)
        self.clock_s = None
        #: How late the last stream wrote a message, at most.
        self.late_s = 0.0

    def topic(self, name, kind):
        return Topic(self.participant, f"rt/{name}", kind)

    def reader(self, name, kind, qos=m.qos(reliable=False)):
        return DataReader(self.participant, self.topic(name, kind), qos)

    def wait(self, reader, timeout_s=5.0):
        end_s = time.monotonic() + timeout_s
        while time.monotonic() < end_s:
            if samples := reader.take(1):
                return samples[0]
            time.sleep(0.005)
        raise TimeoutError("no message")

    def wait_until(self, reader, condition):
        """Waits for a message for which the condition holds, among those of 5 s."""
        end_s = time.monotonic() + 5
        while not condition(self.wait(reader)):
            assert time.monotonic() < end_s, "no such message"

    def see_clock(self, wait_s=0.0):
        """The robot's clock minus the monotonic clock: the largest is from the message that took the shortest time."""
        time.sleep(wait_s)
        for state in self.joint_states.take(1):
            offset_s = m.nanoseconds(state.header.stamp) / m.NS_PER_S - time.monotonic()
            self.clock_s = max(offset_s, self.clock_s or offset_s)

    def stream(self, seconds, amplitude=0.2):
        """Every 10 ms: two points of the past, now, and two of the future. Returns when it began on the robot's clock."""
        for _ in range(100):
            self.see_clock(wait_s=0.002)
        begin_s, self.late_s = time.monotonic(), 0.0
        for k in range(round(100 * seconds)):
            time.sleep(max(0, begin_s + k / 100 - time.monotonic()))
            self.late_s = max(self.late_s, time.monotonic() - begin_s - k / 100)
            self.see_clock()
            stamp = m.time_of(round((begin_s + self.clock_s + (k - 2) / 100 + DELAY_S) * m.NS_PER_S))
            curve = [wave((k + i) / 100, amplitude) for i in range(-2, 3)]
            for name, joints in ROBOT.controllers.items():
                at = [ROBOT.joints.index(joint) for joint in joints]
                points = [m.JointTrajectoryPoint(q[at].tolist(), v[at].tolist(), [], [], m.Duration(0, 10_000_000 * i))
                          for i, (q, v) in enumerate(curve)]
                self.commands[name].write(m.JointTrajectory(m.Header(stamp), joints, points))
        return begin_s + self.clock_s


def wave(t_s, amplitude):
    """All joints swing about home and begin at rest: A (1 - cos w t) / 2 at 0.5 Hz. The lift moves a tenth, downwards."""
    omega, size = 2 * np.pi * 0.5, amplitude * np.array([-0.1 if "lift" in joint else 1.0 for joint in ROBOT.joints])
    t_s = max(t_s, 0.0)
    return ROBOT.home + size * (1 - np.cos(omega * t_s)) / 2, size * omega * np.sin(omega * t_s) / 2


@pytest.fixture
def start(tmp_path):
    """Starts a peer with more arguments. Returns it and a function that ends it and gives report and trace."""
    started = []

    def begin(*arguments):
        paths = tmp_path / "report.json", tmp_path / "trace.csv"
        command = [sys.executable, PEER / "peer.py", "--domain", DOMAIN, "--interface", "lo", "--stdin", *arguments,
                   "--report", paths[0], "--trace", paths[1]]
        process = subprocess.Popen([str(part) for part in command], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        started.append(process)
        assert process.stdout.readline().startswith("ready")

        def end():
            process.stdin.close()
            assert process.wait(10) == 0
            rows = list(csv.reader(paths[1].open()))
            return json.loads(paths[0].read_text()), np.array(rows[1:], dtype=float)

        return process, end

    yield begin
    for process in started:
        process.kill()


def in_time(run):
    """Runs a measurement until nobody was late. `run` returns a client, a report and more, which this returns."""
    for _ in range(RUNS):
        client, report, *more = run()
        if client.late_s < LATE_MAX_S and report["late_max_ms"] < 1e3 * LATE_MAX_S:
            return report, *more
    pytest.skip(f"this machine was late in each of {RUNS} runs")


def follows(trace, begin_s, seconds, amplitude=0.2):
    """Largest difference, in rad or m, of reference and of measured from the wave while it streamed."""
    rows = trace[(trace[:, 1] > begin_s + 0.1) & (trace[:, 1] < begin_s + seconds)]
    assert len(rows) > 40 * (seconds - 0.1)
    wanted = np.array([wave(clock_s - begin_s - DELAY_S, amplitude)[0] for clock_s in rows[:, 1]])
    end = 2 + 2 * len(ROBOT.joints)
    return np.abs(rows[:, 2:end:2] - wanted).max(), np.abs(rows[:, 3:end:2] - wanted).max()


def test_peer_shows_a_robot(start):
    start("--no-physics")
    client = Client()
    description = client.reader("robot_description", m.String, m.LATCHED)
    assert client.wait(description).data == described(ROBOT.urdf, ROBOT.grippers)
    assert not client.wait(client.reader("power/is_emergency", m.Bool)).data
    state = client.wait(client.reader("arm_left_controller/controller_state", m.JointTrajectoryControllerState))
    assert state.joint_names == ROBOT.controllers["arm_left_controller"]
    assert set(ROBOT.joints) <= set(client.wait(client.joint_states).name)


def test_peer_follows_a_stream(start):
    def run():
        _, end = start("--no-physics")
        client = Client()
        begin_s = client.stream(2.0)
        return client, *end(), begin_s

    report, trace, begin_s = in_time(run)
    reference, measured = follows(trace, begin_s, 2.0)
    print(f"reference {1e3 * reference:.3f} mrad, measured {1e3 * measured:.3f} mrad, late {report['late_max_ms']} ms")
    # A joint is where it was commanded one update ago.
    assert reference < 1e-3 and 1e-3 < measured < 5e-3
    for traffic in report["controllers"].values():
        assert traffic["received"] >= 180 and not traffic["rejected"] and traffic["accepted"] == traffic["received"]
    for key in ("position_excess", "velocity_share"):
        assert report["command"][key]["exceeded_updates"] == 0


def test_body_follows_and_touches_nothing(start):
    pytest.importorskip("mujoco")
    if not DESCRIPTION:
        print("without meshes: PEER_DESCRIPTION names no folder with tiago_dual.urdf and meshes")
    described = ["--urdf", f"{DESCRIPTION}/tiago_dual.urdf", "--meshes", DESCRIPTION] if DESCRIPTION else []

    def run():
        _, end = start(*described)
        client = Client()
        begin_s = client.stream(3.0)
        return client, *end(), begin_s

    report, trace, begin_s = in_time(run)
    reference, measured = follows(trace, begin_s, 3.0)
    print(f"reference {1e3 * reference:.3f} mrad, measured {1e3 * measured:.1f} mrad, late {report['late_max_ms']} ms, "
          f"overruns {report['overruns']}, torque {report['torque_share']['worst']:.2f}, contacts {report['contacts']}")
    assert report["contacts_judged"] == bool(DESCRIPTION) and not report["contacts"]
    assert reference < 1e-3 and 1e-3 < measured < 0.05
    assert 0.1 < report["torque_share"]["worst"] < 0.85 and not report["torque_share"]["saturated_steps"]
    assert report["measured"]["acceleration_share"]["worst"] < 1


def test_faults_at_run_time(start):
    process, end = start("--no-physics", "--fault", "lost=1/head_controller", "--fault", "inactive/torso_controller")
    client = Client()
    client.stream(0.5)
    state = client.reader("arm_left_controller/controller_state", m.JointTrajectoryControllerState)
    assert client.wait(state)
    with pytest.raises(TimeoutError):
        client.wait(client.reader("torso_controller/controller_state", m.JointTrajectoryControllerState), 0.3)

    def say(line):
        process.stdin.write(line + "\n")
        process.stdin.flush()

    before_s = client.clock_s
    say("clear")
    say("stamps=1")
    client.wait_until(client.joint_states,
                      lambda said: m.nanoseconds(said.header.stamp) / m.NS_PER_S - time.monotonic() > before_s + 0.9)
    say("clear")
    say("names/arm_left_controller")
    client.wait_until(state, lambda said: said.joint_names[0] == "other_arm_left_1_joint")
    client.stream(0.3)
    say("clear")
    client.wait_until(state, lambda said: said.joint_names[0] == "arm_left_1_joint")
    say("partition+1.2")
    with pytest.raises(TimeoutError):
        # It begins once the peer has read its line.
        for _ in range(50):
            client.wait(state, 0.3)
    client.stream(0.3)
    time.sleep(0.7)
    assert client.wait(state).joint_names[0] == "arm_left_1_joint"
    report, _ = end()
    traffic = report["controllers"]
    assert traffic["head_controller"]["lost_by_fault"] > traffic["arm_right_controller"]["lost_by_fault"] + 40
    assert traffic["torso_controller"]["rejected"]["controller inactive"] > 40
    assert traffic["arm_left_controller"]["rejected"]["joint names"] > 20
    assert traffic["arm_right_controller"]["lost_by_fault"] > 20 and not traffic["arm_right_controller"]["rejected"]


def test_second_publisher_and_emergency_are_seen(start):
    start("--no-physics", "--fault", "second/torso_controller@0.3", "--fault", "emergency@0.3")
    client, publishers = Client(), set()
    builtin = BuiltinDataReader(client.participant, BuiltinTopicDcpsPublication)
    pressed = client.reader("power/is_emergency", m.Bool)
    end_s = time.monotonic() + 3
    while time.monotonic() < end_s and len(publishers) < 2:
        publishers |= {str(p.key) for p in builtin.take(50) if getattr(p, "topic_name", "") == "rt/torso_controller/joint_trajectory"}
        time.sleep(0.05)
    assert len(publishers) == 2, "the client's own and another"
    while not client.wait(pressed).data:
        assert time.monotonic() < end_s + 3


def test_fault_is_read():
    fault = parse("lost=0.25/head_controller@5+2", now_s=10)
    assert (fault.kind, fault.value, fault.controller, fault.begin_s, fault.end_s) == ("lost", 0.25, "head_controller", 15, 17)
    for wrong in ("lost", "partition=5", "gone=1", "lost=0.1@x"):
        with pytest.raises(ValueError):
            parse(wrong)
