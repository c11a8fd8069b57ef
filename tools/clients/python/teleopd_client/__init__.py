"""Publishes skeletons to teleopd over shared memory.

    from teleopd_client import SkeletonPublisher

    with SkeletonPublisher() as publisher:
        publisher.publish(positions)        # 22 x 3, metres, x forward, y left, z up

`examples/own.py` beside this package is a whole client; `teleopd-replay` plays a wave or a recording.

Frames are expected at 30 to 240 Hz. Nothing moves before an operator engages (`teleopctl engage`), and whatever is wrong
with a frame is dropped and counted by the daemon, which stops the robot if no good one comes for 100 ms.
"""

import ctypes
import json
import math
import os
import random
import socket
import struct
import sys
import time

import iceoryx2

from . import layout as _layout
from .layout import *  # noqa: F403
from .layout import LAYOUT_SMPL22, RAW_JOINTS_MAX, Feedback, HingeCalibration, Joints, PolicyChunk, RawSkeleton

#: the folder of an instance that was given none
DEFAULT_RUN_DIR = "/tmp/teleopd"
#: joints of the layouts; those from files (`[ingest] layouts`) have other numbers, and are not counted here
JOINTS = {
    LAYOUT_SMPL22: 22,
    _layout.LAYOUT_SMPL24: 24,
    _layout.LAYOUT_XR_BD24: 24,
    _layout.LAYOUT_MEDIAPIPE33: 33,
    _layout.LAYOUT_MEDIAPIPE66: 66,
    _layout.LAYOUT_AZURE_KINECT32: 32,
    _layout.LAYOUT_XSENS_MVN23: 23,
    _layout.LAYOUT_UNITY: 55,
}


class TeleopdError(RuntimeError):
    """The daemon cannot be reached, or a frame cannot be sent."""


def _prefix(run_dir):
    """What the names of an instance's input domain begin with: FNV-1a (64 bit) of its folder, the lower half."""
    value = 0xCBF29CE484222325
    for byte in os.fsencode(run_dir):
        value = ((value ^ byte) * 0x100000001B3) & 0xFFFFFFFFFFFFFFFF
    return f"teleop_input_{value & 0xFFFFFFFF:08x}_"


def _node(run_dir):
    """A node in the input domain of an instance, and the instance's folder."""
    run_dir = os.path.realpath(run_dir)
    root = os.path.join(run_dir, "input")
    if not os.path.isdir(root):
        raise TeleopdError(f"{root}: no such folder: is `teleopd up --run-dir {run_dir}` running?")
    owner, own = os.stat(root).st_uid, os.geteuid()
    if own not in (0, owner):
        raise TeleopdError(
            f"{run_dir}: this instance belongs to user {owner}, and this program runs as user {own}. Shared memory serves "
            f"one user. Run this as that user (sudo -u '#{owner}' ...)"
        )
    iceoryx2.set_log_level(iceoryx2.LogLevel.Fatal)
    config = iceoryx2.config.default()
    config.global_cfg.root_path = iceoryx2.Path.new(root)
    config.global_cfg.prefix = iceoryx2.FileName.new(_prefix(run_dir))
    builder = iceoryx2.NodeBuilder.new().config(config)
    builder = builder.signal_handling_mode(iceoryx2.SignalHandlingMode.Disabled)
    try:
        return builder.create(iceoryx2.ServiceType.Ipc), run_dir
    except Exception as error:
        raise _no_instance(error, run_dir, "connect", RawSkeleton) from error


def _no_instance(error, run_dir, what, message):
    """The error of a client that cannot `what`."""
    if "DoesNotExist" in str(error):
        return TeleopdError(f"no instance of teleopd runs in {run_dir}: start `teleopd up --run-dir {run_dir}`")
    if "ExceedsMaxSupported" in str(error):
        return TeleopdError(f"{run_dir}: cannot {what}: all places are taken (8 that publish, 16 that read)")
    return TeleopdError(
        f"{run_dir}: cannot {what} ({type(error).__name__}: {error}): does teleopd run there, as this user, in the version of "
        f"this module ({message.type_name()})?"
    )


class _Writer:
    """Writes one message of a new session to a service of the input domain, again and again, and wakes `ingest`."""

    def __init__(self, run_dir, service, message):
        self._node, run_dir = _node(run_dir)
        try:
            data = self._node.service_builder(iceoryx2.ServiceName.new(service)).publish_subscribe(message).open()
            event = self._node.service_builder(iceoryx2.ServiceName.new(_layout.EVENT_SERVICE)).event().open()
            publisher = data.publisher_builder().backpressure_strategy(iceoryx2.BackpressureStrategy.DiscardData)
            self._publisher = publisher.create()
            self._notifier = event.notifier_builder().create()
        except Exception as error:
            raise _no_instance(error, run_dir, "publish", message) from error
        self.message = message()
        self.message.session_nonce = random.SystemRandom().getrandbits(64) or 1
        self.message.header.incarnation = random.SystemRandom().getrandbits(32)

    def send(self, what):
        """Sends the message, whose header has its stamps; answers its sequence number."""
        sequence = self.message.header.sequence
        try:
            self._publisher.send_copy(self.message)
            self._notifier.notify()
        except Exception as error:
            raise TeleopdError(f"{what} {sequence} was not sent: {type(error).__name__}: {error}") from error
        return sequence

    def close(self):
        for port in (self._publisher, self._notifier):
            port.delete()


class SkeletonPublisher:
    """A client of a running daemon, of the same user.

    run_dir: the `--run-dir` of `teleopd up`. layout: a `LAYOUT_*` number. operator_id: which person, if you track several;
    another number is another person, who has to be engaged anew.

    The first client that publishes holds authority. Raises TeleopdError if the daemon does not run, or another version.
    """

    def __init__(self, run_dir=DEFAULT_RUN_DIR, layout=LAYOUT_SMPL22, operator_id=0):
        self._writer = _Writer(run_dir, _layout.SERVICE, RawSkeleton)
        self._frame = self._writer.message
        self._frame.layout = layout
        self._frame.operator_id = operator_id

    @classmethod
    def or_exit(cls, *arguments, **named):
        """As the constructor. Without a daemon it says so in a sentence and ends the program."""
        try:
            return cls(*arguments, **named)
        except TeleopdError as error:
            sys.exit(str(error))

    def publish(self, positions, rotations=None, confidence=None, seen_ns=None, mirrored=False, local=False, calibration=None, clutch=False, closure=(None, None)):
        """Publishes one frame; answers its sequence number.

        positions: a row of three numbers for each joint of the layout, in its unit and axes. rotations: unit quaternions in
        the layout's order, global, or relative to the parent joint if `local`. confidence: one number each (default: 1). seen_ns: when the person was seen, on CLOCK_MONOTONIC
        (`time.monotonic_ns()`, default: now); give the time of capture, because the robot's latency is counted from it.
        mirrored: the image was (a selfie camera's). calibration: a HingeCalibration, if you have one. clutch: the robot stands
        until a frame without it; then it moves slowly to where the person is. closure: of the left and of the right hand, 0
        (open) to 1 (closed), or None if it is not known; the robot's gripper follows it from where the two meet.

        Raises ValueError for a frame that no layout has; what the numbers say is judged by the daemon.
        """
        frame = self._frame
        count = len(positions)
        expected = JOINTS.get(frame.layout, count)
        if count != expected or count > RAW_JOINTS_MAX:
            raise ValueError(f"positions: {count} joints, {expected} expected, at most {RAW_JOINTS_MAX}")
        _fill(frame.positions, positions, 3, "positions", count)
        if rotations is not None:
            _fill(frame.rotations, rotations, 4, "rotations", count)
        given = [1.0] * count if confidence is None else confidence
        if len(given) != count:
            raise ValueError(f"confidence: {len(given)} numbers for {count} joints")
        for i in range(count):
            frame.confidence[i] = given[i]
        frame.joint_count = count
        frame.flags = (
            (_layout.FLAG_ROTATIONS if rotations is not None else 0)
            | (_layout.FLAG_MIRRORED if mirrored else 0)
            | (_layout.FLAG_LOCAL if local else 0)
            | (_layout.FLAG_CLUTCH if clutch else 0)
            | _closure_bits(closure)
        )
        frame.calibration = calibration if calibration is not None else HingeCalibration()
        now = time.monotonic_ns()
        frame.header.sequence += 1
        frame.header.stamp = now
        frame.header.origin = now if seen_ns is None else seen_ns
        return self._writer.send("frame")

    def close(self):
        """Leaves; the robot stops within 100 ms plus its stop, as at any silence."""
        self._writer.close()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()


#: what to say if `lease_is_held`
HELD = (
    "Another client holds the lease, so the robot does not see this motion. End that client, wait a second, and start this one "
    "again."
)


def lease_is_held(run_dir=DEFAULT_RUN_DIR):
    """True if a client holds the lease now. Shared memory gives no answer, so this asks at the skeleton socket."""
    _, _, version, layout = RawSkeleton.type_name().split(".")
    hello = struct.pack("<4sIIIQQ", b"TPSK", 1, int(version[1:]), ctypes.sizeof(RawSkeleton), int(layout, 16), 0)
    try:
        with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as door:
            door.settimeout(1)
            door.connect(os.path.join(run_dir, "skeleton.sock"))
            door.send(hello)
            # 2: frames are taken, but another client holds the lease.
            return struct.unpack_from("<4sI", door.recv(24)) == (b"TPSK", 2)
    except (OSError, struct.error):
        return False


class _Reader:
    """Reads the newest message of a service of the input domain."""

    def __init__(self, run_dir, service, message):
        self._node, run_dir = _node(run_dir)
        self._message = message
        try:
            data = self._node.service_builder(iceoryx2.ServiceName.new(service)).publish_subscribe(message).open()
            self._subscriber = data.subscriber_builder().create()
        except Exception as error:
            raise _no_instance(error, run_dir, "read", message) from error

    def latest(self):
        """The newest message that was not read before, or None.

        Its fields are those of layout.py. `known` says which of them mean something. `header.stamp` is its time
        (`time.monotonic_ns()`); nothing comes from a daemon that has ended.
        """
        newest = None
        while (sample := self._subscriber.receive()) is not None:
            newest = self._message.from_buffer_copy(bytes(sample.payload().contents))
            sample.delete()
        return newest

    def close(self):
        """Leaves."""
        self._subscriber.delete()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()


class FeedbackReader(_Reader):
    """Reads what the robot does, for a display, a glove or a headset that vibrates: a `Feedback`, 20 times a second, with
    angles in rad, lengths in m, forces in N. `sentence(feedback)` is its text.

    run_dir: the `--run-dir` of `teleopd up`. Raises TeleopdError if the daemon does not run, or another version.
    """

    def __init__(self, run_dir=DEFAULT_RUN_DIR):
        super().__init__(run_dir, _layout.FEEDBACK_SERVICE, Feedback)


class JointsReader(_Reader):
    """Reads the joints, commanded and measured, and who leads each arm: a `Joints`, 100 times a second.

    run_dir: the `--run-dir` of `teleopd up`. Raises TeleopdError if the daemon does not run, or another version.
    """

    def __init__(self, run_dir=DEFAULT_RUN_DIR):
        super().__init__(run_dir, _layout.JOINTS_SERVICE, Joints)
        self.names = joint_names(run_dir)


def joint_names(run_dir=DEFAULT_RUN_DIR):
    """Names of the robot's joints, in the order of every message."""
    try:
        with open(os.path.join(run_dir, "names.json"), encoding="utf-8") as file:
            return list(json.load(file)["joints"])
    except (OSError, KeyError, ValueError) as error:
        raise TeleopdError(f"{run_dir}: the names of the joints cannot be read ({error}): does `teleopd up` run there?") from error


#: age of `Joints` that a policy may still rest on: they come every 10 ms
OLD_NS = 500_000_000


class Policy:
    """A program that leads the robot by joint targets, under an operator's enable.

    run_dir: the `--run-dir` of `teleopd up`. joints: names or indices of the columns of its rows; a joint that it does not
    name stays where it is. Everything that it asks for is followed within the limits, certified, and checked by the gate.

        with Policy(joints=["arm_left_1_joint"]) as policy:
            state = policy.observe()                 # Joints: commanded, measured, mode, sources, short_of
            policy.publish(rows, rate_hz=20)         # (1 to 100, joints), rad or m

    The first policy that publishes holds the lease of policies. Raises TeleopdError if the daemon does not run, or another
    version.
    """

    def __init__(self, run_dir=DEFAULT_RUN_DIR, joints=None):
        self._reader = JointsReader(run_dir)
        self.names = self._reader.names
        given = range(len(self.names)) if joints is None else joints
        unknown = [name for name in given if isinstance(name, str) and name not in self.names]
        if unknown:
            raise ValueError(f"joints: the robot has no {unknown[0]}; it has {', '.join(self.names)}")
        self.joints = [self.names.index(joint) if isinstance(joint, str) else int(joint) for joint in given]
        if len(set(self.joints)) != len(self.joints) or not all(0 <= j < len(self.names) for j in self.joints):
            raise ValueError(f"joints: {self.joints}: each once, 0 to {len(self.names) - 1}")
        self._writer = _Writer(run_dir, _layout.POLICY_SERVICE, PolicyChunk)
        self._chunk = self._writer.message
        self._state = self._newest = None

    def observe(self, within_s=2.0):
        """The newest `Joints`. Waits up to `within_s` for one that is not old. Chunks that are published next rest on it."""
        give_up = time.monotonic() + within_s
        while True:
            self._newest = self._reader.latest() or self._newest
            state = self._newest
            old = state is None or time.monotonic_ns() - state.header.stamp > OLD_NS
            if not old and state.known & _layout.JOINTS_STATE:
                self._state = state
                return state
            if time.monotonic() > give_up:
                raise TeleopdError("no joints came: does the driver run, and does it measure?")
            time.sleep(0.002)

    def publish(self, rows, rate_hz, start_ns=None, velocities=None, closure=(None, None), observed=None):
        """Publishes a chunk; answers its sequence number.

        rows: 1 to 100 rows of joint positions (rad, m), a column for each of `joints`. rate_hz: rows a second, 1 to 200.
        start_ns: time of the first row on CLOCK_MONOTONIC; by default now, and for a single row a period from now, so that a
        stream of single rows is a polyline. velocities: as rows; without them a curve through the rows has its own.
        closure: for the left and the right gripper a number for each row, 0 (open) to 1 (closed), or None.

        The chunk replaces the one before from its start on. It rests on `observed`, or on the last `observe()`: after a person has led an arm,
        a chunk counts only if that was later. Raises ValueError for rows that no chunk has.
        """
        if self._state is None:
            self.observe()
        chunk, count = self._chunk, len(rows)
        if not 1 <= count <= _layout.CHUNK_ROWS_MAX:
            raise ValueError(f"rows: {count}: must be 1 to {_layout.CHUNK_ROWS_MAX}")
        if not 1.0 <= rate_hz <= 200.0:
            raise ValueError(f"rate_hz: {rate_hz}: must be 1 to 200")
        chunk.robot = self._state.robot
        chunk.rows, chunk.period_ns, chunk.flags, chunk.valid_mask = count, round(1e9 / rate_hz), 0, 0
        for j in self.joints:
            chunk.valid_mask |= 1 << j
        self._fill(chunk.q, rows, "rows", count)
        if velocities is not None:
            chunk.flags |= _layout.CHUNK_VELOCITIES
            self._fill(chunk.v, velocities, "velocities", count)
        for hand, values in enumerate(closure):
            if values is not None:
                if len(values) != count or not all(0.0 <= value <= 1.0 for value in values):
                    raise ValueError(f"closure[{hand}]: {count} numbers from 0 to 1 expected")
                chunk.flags |= (_layout.CHUNK_CLOSURE_LEFT, _layout.CHUNK_CLOSURE_RIGHT)[hand]
                for i, value in enumerate(values):
                    chunk.closure[i][hand] = value
        now = time.monotonic_ns()
        chunk.start = start_ns if start_ns is not None else now + (chunk.period_ns if count == 1 else 0)
        chunk.header.sequence += 1
        chunk.header.stamp = now
        chunk.header.origin = (observed or self._state).header.stamp
        return self._writer.send("chunk")

    def dropped(self):
        """Why the newest chunk was dropped within the last second, or None."""
        self._newest = state = self._reader.latest() or self._newest or self.observe()
        return _layout.CHUNK_DROPS[state.chunk_dropped_why - 1] if state.chunk_dropped_why else None

    def _fill(self, into, rows, what, count):
        if len(rows) != count:
            raise ValueError(f"{what}: {len(rows)} rows for {count}")
        for i, row in enumerate(rows):
            if len(row) != len(self.joints):
                raise ValueError(f"{what}[{i}]: {len(row)} numbers for {len(self.joints)} joints")
            for j, value in zip(self.joints, row, strict=True):
                into[i][j] = value

    def close(self):
        """Leaves; the robot stops where the last chunk ends."""
        self._writer.close()
        self._reader.close()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()


def sentence(feedback):
    """Why the robot does what it does, in one sentence."""
    return bytes(feedback.sentence[: feedback.sentence_bytes]).decode("utf-8", "replace")


def _closure_bits(closure):
    """The closures of both hands in a frame's flags: a byte each, 0 for a hand that is not known."""
    bits = 0
    for value, shift in zip(closure, (16, 24), strict=True):
        if value is not None:
            if not 0.0 <= value <= 1.0:
                raise ValueError(f"closure: {value}: must be 0 to 1, or None")
            bits |= (1 + int(value * 254 + 0.5)) << shift
    return bits


def _fill(into, rows, width, what, count):
    if len(rows) != count:
        raise ValueError(f"{what}: {len(rows)} rows for {count} joints")
    for i, row in enumerate(rows):
        if len(row) != width:
            raise ValueError(f"{what}[{i}]: {len(row)} numbers, {width} expected")
        for j in range(width):
            into[i][j] = row[j]


def rate(frames_per_s):
    """Counts frames at a fixed rate without drift: `for i in rate(60): ...`."""
    if not (math.isfinite(frames_per_s) and frames_per_s > 0):
        raise ValueError(f"rate: {frames_per_s}: must be positive")
    start, i = time.monotonic(), 0
    while True:
        yield i
        i += 1
        pause = start + i / frames_per_s - time.monotonic()
        if pause > 0:
            time.sleep(pause)
