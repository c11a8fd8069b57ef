"""The layout of a frame. Written by cargo test -p messages --test all clients -- --ignored; not to be edited."""

import ctypes

#: the most joints that a frame can carry
RAW_JOINTS_MAX = 96
#: left upper arm, left forearm, right upper arm, right forearm
LIMBS = 4
#: SMPL-22, metres, x forward, y left, z up
LAYOUT_SMPL22 = 1
#: SMPL-22 and both hands, in the same frame
LAYOUT_SMPL24 = 2
#: OpenXR XR_BD_body_tracking, metres, x right, y up, z back
LAYOUT_XR_BD24 = 3
#: MediaPipe Pose world landmarks, metres, y down, z away
LAYOUT_MEDIAPIPE33 = 4
#: Azure Kinect, mm, x right, y down, z away; w x y z
LAYOUT_AZURE_KINECT32 = 5
#: Xsens MVN segments, metres, z up; w x y z
LAYOUT_XSENS_MVN23 = 6
#: Unity HumanBodyBones, left-handed, local rotations
LAYOUT_UNITY = 7
#: MediaPipe33, then the image landmarks, heights of the image from its middle, y down
LAYOUT_MEDIAPIPE66 = 8
#: the image was mirrored: left and right are swapped
FLAG_MIRRORED = 1
#: rotations are filled
FLAG_ROTATIONS = 2
#: they are relative to the parent joint; of the positions the root's alone counts
FLAG_LOCAL = 4
#: the robot stands until a frame without it
FLAG_CLUTCH = 8
#: the two bytes of the hands' closures
FLAG_CLOSURE = 4294901760
#: the most bytes of a sentence
SENTENCE_BYTES = 256
#: mode, faults, speed_scale and sentence are known
FEEDBACK_STATUS = 1
#: clearances and limbs are known
FEEDBACK_STATE = 2
#: the person's left upper arm is seen
FEEDBACK_LIMB_LEFT_UPPER = 16
#: the person's left forearm is seen
FEEDBACK_LIMB_LEFT_FORE = 32
#: the person's right upper arm is seen
FEEDBACK_LIMB_RIGHT_UPPER = 64
#: the person's right forearm is seen
FEEDBACK_LIMB_RIGHT_FORE = 128
#: the left gripper is measured
FEEDBACK_GRIPPER_LEFT = 4
#: the right gripper is measured
FEEDBACK_GRIPPER_RIGHT = 8
#: all four hinges of the calibration are valid
CALIBRATION_ALL = 15
#: the most joints of a robot
JOINTS_MAX = 24
#: the most rows of a policy's chunk
CHUNK_ROWS_MAX = 100
#: the chunk has velocities
CHUNK_VELOCITIES = 1
#: the chunk has the left gripper
CHUNK_CLOSURE_LEFT = 2
#: the chunk has the right gripper
CHUNK_CLOSURE_RIGHT = 4
#: the robot's state is known
JOINTS_STATE = 1
#: mode and sources are known
JOINTS_STATUS = 2
#: a policy holds its lease
JOINTS_POLICY = 4
#: a person leads the left arm
SOURCE_PERSON_LEFT = 1
#: a person leads the right arm
SOURCE_PERSON_RIGHT = 2
#: a policy leads the left arm
SOURCE_POLICY_LEFT = 4
#: a policy leads the right arm
SOURCE_POLICY_RIGHT = 8
#: name of the service that clients write
SERVICE = "teleop/raw_skeleton/1"
#: name of the service that wakes its reader
EVENT_SERVICE = "teleop/raw_skeleton/1/event"
#: names of `Feedback.mode`
MODES = ("Disengaged", "Engaging", "Engaged", "Holding", "Faulted", "Recovering")
#: name of the service that tells clients about the robot
FEEDBACK_SERVICE = "teleop/feedback/1"
#: name of the service that policies write
POLICY_SERVICE = "teleop/policy_chunk/1"
#: name of the service that has the joints
JOINTS_SERVICE = "teleop/joints/2"
#: reasons for which a chunk is dropped: `Joints.chunk_dropped_why` less one
CHUNK_DROPS = (
    "other_robot: it is for another robot; copy `robot` from the newest `Joints`",
    "shape: 1 to 100 rows, 5 to 1000 ms apart, of at least one joint of the robot are allowed",
    "value: a value is not finite, a position or velocity is beyond 10 turns, or a closure is not from 0 to 1; send radians and metres",
    "order: sequence and stamp must grow within a session; count on, or begin a new session",
    "old: its last row is over, or comes more than 10 s after its observation; send shorter chunks sooner",
    "future: its start is more than 1 s ahead, or its observation more than 2 ms; stamp with CLOCK_MONOTONIC in ns",
    "lease: another policy holds the lease, or held it when this session began; begin a new session after it",
    "quota: its publisher sends more than 250 chunks a second; send fewer",
)
#: frames a second that a client may publish at most
RATE_MAX_HZ = 240


class Header(ctypes.Structure):
    """What every message begins with. Times are CLOCK_MONOTONIC, ns."""

    _fields_ = [
        ("sequence", ctypes.c_uint64),
        ("stamp", ctypes.c_uint64),
        ("origin", ctypes.c_uint64),
        ("config_hash", ctypes.c_uint64),
        ("incarnation", ctypes.c_uint32),
        ("reserved", ctypes.c_uint32),
    ]

    @staticmethod
    def type_name():
        """The name under which the transport knows the layout."""
        return "teleop.Header.v1.4983969c05860a03"


assert ctypes.sizeof(Header) == 40


class HingeCalibration(ctypes.Structure):
    """Elbow hinge axes, unit vectors in the frames of the joints that carry them."""

    _fields_ = [
        ("hinge", (ctypes.c_float * 3) * LIMBS),
        ("flags", ctypes.c_uint32),
        ("samples", ctypes.c_uint32),
    ]

    @staticmethod
    def type_name():
        """The name under which the transport knows the layout."""
        return "teleop.HingeCalibration.v1.1ad67fb992569fe3"


assert ctypes.sizeof(HingeCalibration) == 56


class RawSkeleton(ctypes.Structure):
    """A frame of a person."""

    _fields_ = [
        ("header", Header),
        ("session_nonce", ctypes.c_uint64),
        ("layout", ctypes.c_uint32),
        ("operator_id", ctypes.c_uint32),
        ("flags", ctypes.c_uint32),
        ("joint_count", ctypes.c_uint32),
        ("positions", (ctypes.c_float * 3) * RAW_JOINTS_MAX),
        ("rotations", (ctypes.c_float * 4) * RAW_JOINTS_MAX),
        ("confidence", ctypes.c_float * RAW_JOINTS_MAX),
        ("joint_flags", ctypes.c_uint32 * RAW_JOINTS_MAX),
        ("calibration", HingeCalibration),
    ]

    @staticmethod
    def type_name():
        """The name under which the transport knows the layout."""
        return "teleop.RawSkeleton.v1.dfc4ba58ef1b0e5e"


assert ctypes.sizeof(RawSkeleton) == 3576


class Feedback(ctypes.Structure):
    """State of the robot for the person who drives it. Directions: torso, x forward, y left, z up."""

    _fields_ = [
        ("header", Header),
        ("faults", ctypes.c_uint64),
        ("mode", ctypes.c_uint32),
        ("known", ctypes.c_uint32),
        ("speed_scale", ctypes.c_float),
        ("clearance_m", ctypes.c_float * 2),
        ("towards_nearest", (ctypes.c_float * 3) * 2),
        ("limb_behind_rad", ctypes.c_float * LIMBS),
        ("closure", ctypes.c_float * 2),
        ("force_n", ctypes.c_float * 2),
        ("sentence_bytes", ctypes.c_uint32),
        ("sentence", ctypes.c_uint8 * SENTENCE_BYTES),
    ]

    @staticmethod
    def type_name():
        """The name under which the transport knows the layout."""
        return "teleop.Feedback.v1.6ab268c77bf85042"


assert ctypes.sizeof(Feedback) == 384


class RobotId(ctypes.Structure):
    """The robot that a message is about."""

    _fields_ = [
        ("hash", ctypes.c_uint64),
        ("joint_count", ctypes.c_uint32),
        ("reserved", ctypes.c_uint32),
    ]

    @staticmethod
    def type_name():
        """The name under which the transport knows the layout."""
        return "teleop.RobotId.v1.41c6f16b2eb09755"


assert ctypes.sizeof(RobotId) == 16


class PolicyChunk(ctypes.Structure):
    """Joint targets of a policy: row i is due at start + i * period_ns. Positions in rad or m."""

    _fields_ = [
        ("header", Header),
        ("session_nonce", ctypes.c_uint64),
        ("robot", RobotId),
        ("received", ctypes.c_uint64),
        ("start", ctypes.c_uint64),
        ("period_ns", ctypes.c_uint64),
        ("rows", ctypes.c_uint32),
        ("valid_mask", ctypes.c_uint32),
        ("flags", ctypes.c_uint32),
        ("reserved", ctypes.c_uint32),
        ("q", (ctypes.c_float * JOINTS_MAX) * CHUNK_ROWS_MAX),
        ("v", (ctypes.c_float * JOINTS_MAX) * CHUNK_ROWS_MAX),
        ("closure", (ctypes.c_float * 2) * CHUNK_ROWS_MAX),
    ]

    @staticmethod
    def type_name():
        """The name under which the transport knows the layout."""
        return "teleop.PolicyChunk.v1.81b56ee2e4a9d87e"


assert ctypes.sizeof(PolicyChunk) == 20104


class Joints(ctypes.Structure):
    """The joints of the robot, 100 times a second, in rad, m and s."""

    _fields_ = [
        ("header", Header),
        ("robot", RobotId),
        ("k", ctypes.c_uint64),
        ("mode", ctypes.c_uint32),
        ("sources", ctypes.c_uint32),
        ("known", ctypes.c_uint32),
        ("chunk_dropped_why", ctypes.c_uint32),
        ("chunks_dropped", ctypes.c_uint64 * 8),
        ("commanded", ctypes.c_double * JOINTS_MAX),
        ("commanded_v", ctypes.c_double * JOINTS_MAX),
        ("measured", ctypes.c_double * JOINTS_MAX),
        ("measured_v", ctypes.c_double * JOINTS_MAX),
        ("short_of", ctypes.c_double * JOINTS_MAX),
    ]

    @staticmethod
    def type_name():
        """The name under which the transport knows the layout."""
        return "teleop.Joints.v2.e74329851af83f2e"


assert ctypes.sizeof(Joints) == 1104
