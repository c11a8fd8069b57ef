"""The robot's topics over DDS, with the qualities of service of its controllers and its joint_state_broadcaster."""

from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.internal import InvalidSample
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

import messages as m
import unitree
from trajectory import Reference

#: No more commands wait in a reader, see `messages.py`.
TAKE_MAX = 16
#: Topic and type of the commands of a controller, by the interface.
COMMANDS = {"trajectories": ("{}/joint_trajectory", m.JointTrajectory), "positions": ("{}/commands", m.Float64MultiArray),
            "arm_sdk": ("arm_sdk", unitree.LowCmd)}


class Wire:
    def __init__(self, domain: int, interface: str | None, best_effort: bool, controllers, description: str, commands: str):
        self.domain, (self.name, self.kind) = domain, COMMANDS[commands]
        if interface:
            # The loopback interface does not claim multicast, but Linux carries it.
            interfaces = f'<Interfaces><NetworkInterface name="{interface}" multicast="true"/></Interfaces>'
            self.configuration = Domain(domain, f"<CycloneDDS><Domain><General>{interfaces}</General></Domain></CycloneDDS>")
        self.participant = DomainParticipant(domain)
        reader_qos = m.READER_BEST_EFFORT if best_effort else m.READER_RELIABLE
        self.commands = {name: DataReader(self.participant, self._topic(self.name.format(name), self.kind), reader_qos)
                         for name in controllers}
        self.second: dict[str, DataWriter] = {}
        if commands == "arm_sdk":
            self.low_state = self._writer("lowstate", unitree.LowState)
            return
        is_trajectory = commands == "trajectories"
        self.states = {name: self._writer(f"{name}/controller_state", m.JointTrajectoryControllerState)
                       for name in controllers if is_trajectory}
        self.joint_states = self._writer("joint_states", m.JointState)
        # Another program publishes it, with a participant of its own.
        self.watch = DomainParticipant(domain)
        self.is_emergency = DataWriter(self.watch, Topic(self.watch, "rt/power/is_emergency", m.Bool), m.WRITER)
        self.is_unwatched = False
        self.description = self._writer("robot_description", m.String, m.LATCHED)
        self.description.write(m.String(description))

    def _topic(self, name: str, kind) -> Topic:
        return Topic(self.participant, f"rt/{name}", kind)

    def _writer(self, name: str, kind, qos=m.WRITER) -> DataWriter:
        return DataWriter(self.participant, self._topic(name, kind), qos)

    def take(self, controller: str) -> list:
        return [sample for sample in self.commands[controller].take(TAKE_MAX) if not isinstance(sample, InvalidSample)]

    def publish_low_state(self, packed: bytes) -> None:
        state = unitree.LowState()
        state.packed = packed
        self.low_state.write(state)

    def publish_joint_states(self, stamp_ns: int, names: list[str], position, velocity, effort) -> None:
        header = m.Header(m.time_of(stamp_ns))
        self.joint_states.write(m.JointState(header, names, list(position), list(velocity), list(effort)))

    def publish_controller_state(self, name: str, stamp_ns: int, joints: list[str], reference: Reference, measured) -> None:
        """As a controller with position interfaces only fills it."""
        wanted = [list(values) for values in (reference.positions, reference.velocities, reference.accelerations)]
        self.states[name].write(m.JointTrajectoryControllerState(
            m.Header(m.time_of(stamp_ns)), joints, m.JointTrajectoryPoint(*wanted), m.JointTrajectoryPoint(list(measured)),
            m.JointTrajectoryPoint(list(reference.positions - measured)), m.JointTrajectoryPoint(wanted[0])))

    def publish_emergency(self, pressed: bool) -> None:
        if not self.is_unwatched:
            self.is_emergency.write(m.Bool(pressed))

    def leave_emergency(self) -> None:
        """The publisher of the emergency stop leaves, for good."""
        if not self.is_unwatched:
            self.watch._delete(self.watch._ref)
            self.is_unwatched = True

    def set_second_publisher(self, controller: str, present: bool) -> None:
        """Another program, with a participant of its own, that could publish on a command topic."""
        if present and controller not in self.second:
            other = DomainParticipant(self.domain)
            topic = Topic(other, f"rt/{self.name.format(controller)}", self.kind)
            self.second[controller] = DataWriter(other, topic, m.WRITER)
        elif not present:
            self.second.pop(controller, None)
