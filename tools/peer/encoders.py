"""Compares the bytes of commands with those of an encoder that shares no code with their sender.

Commands of ROS are read and written again by rosbags, those of Unitree by Cyclone DDS. The CRC is computed by `arm_sdk`.
"""

import unitree

#: Messages to compare.
COUNT = 20
#: Names that rosbags gives to the types.
ROS_TYPES = {"trajectories": "trajectory_msgs/msg/JointTrajectory", "positions": "std_msgs/msg/Float64MultiArray"}


def written_again(commands: str, data: bytes) -> bytes:
    if commands == "arm_sdk":
        expected = unitree.parse_command(data).expected_crc()
        message = unitree.GenericLowCmd.deserialize(data)
        if message.crc != expected:
            raise SystemExit(f"the CRC is {message.crc:#x}, must be {expected:#x}")
        return message.serialize(use_version_2=False)
    from rosbags.typesys import Stores, get_typestore

    store, name = get_typestore(Stores.ROS2_HUMBLE), ROS_TYPES[commands]
    return bytes(store.serialize_cdr(store.deserialize_cdr(data, name), name))


def unpadded(data: bytes) -> bytes:
    """Without the bytes that fill the last word, whose number the header may have."""
    return data[:2] + data[4:].rstrip(b"\0")


class Comparison:
    """Stands before the reader of a type. Prints a line once `COUNT` messages agreed, and ends the peer if one does not."""

    def __init__(self, commands: str, kind):
        self.commands, self.read, self.compared = commands, kind.deserialize, 0
        kind.deserialize = staticmethod(self.compare)

    def compare(self, data: bytes, **options):
        if self.compared < COUNT:
            again = written_again(self.commands, data)
            if unpadded(again) != unpadded(data):
                raise SystemExit(f"sent {data.hex()}\nagain {again.hex()}")
            self.compared += 1
            if self.compared == COUNT:
                print(f"{COUNT} messages agree", flush=True)
        return self.read(data, **options)
