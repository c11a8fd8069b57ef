#!/usr/bin/env python3
"""Publishes a motion to teleopd: a built-in wave, or a recording of SMPL-22 positions, `.npy` of shape (N, 22, 3), metres.

    teleopd-replay                       # the wave, for ever
    teleopd-replay clip.npy --up y --rate 20
"""

import argparse
import math
import os
import signal
import sys

from teleopd_client import DEFAULT_RUN_DIR, HELD, SkeletonPublisher, TeleopdError, lease_is_held, rate

#: a standing person of 1.75 m without arms: SMPL-22, metres, x forward, y left, z up (proportions: Winter, Biomechanics,
#: fig. 4.1); the left half, and what lies between
MIDDLE = {0: (0.0, 0.98), 3: (-0.01, 1.07), 6: (-0.02, 1.17), 9: (-0.02, 1.28), 12: (-0.04, 1.47), 15: (0.0, 1.59)}
LEFT = {1: (0.0, 0.096, 0.928), 4: (0.018, 0.096, 0.499), 7: (0.0, 0.096, 0.068), 10: (0.14, 0.114, 0.026),
        13: (-0.03, 0.053, 1.4), 16: (-0.04, 0.184, 1.432)}
#: what mirrors a joint of the left half
RIGHT = {1: 2, 4: 5, 7: 8, 10: 11, 13: 14, 16: 17}
UPPER_ARM_M, FOREARM_M = 0.326, 0.256


def person(raise_rad, flex_rad, sway_m=0.0):
    """SMPL-22 positions of a person whose arms are raised to the sides by `raise_rad` from hanging, and whose elbows are
    flexed by `flex_rad` to the front."""
    joints = [None] * 22
    for joint, (x, z) in MIDDLE.items():
        joints[joint] = [x, 0.0, z]
    for joint, (x, y, z) in LEFT.items():
        joints[joint] = [x, y, z]
        joints[RIGHT[joint]] = [x, -y, z]
    out, down = math.sin(raise_rad), -math.cos(raise_rad)
    for side, shoulder, elbow, wrist in ((1, 16, 18, 20), (-1, 17, 19, 21)):
        x, y, z = joints[shoulder]
        joints[elbow] = [x, y + side * out * UPPER_ARM_M, z + down * UPPER_ARM_M]
        x, y, z = joints[elbow]
        along = math.cos(flex_rad) * FOREARM_M
        joints[wrist] = [x + math.sin(flex_rad) * FOREARM_M, y + side * out * along, z + down * along]
    return [[x + sway_m, y, z] for x, y, z in joints]


def wave(i, frames_per_s):
    """Frame `i` of the built-in motion: arms rise and sink every 8 s, elbows flex every 5 s."""
    t = i / frames_per_s
    lift = 0.9 - 0.5 * math.cos(2 * math.pi * t / 8)
    flex = 0.7 - 0.5 * math.cos(2 * math.pi * t / 5)
    return person(lift, flex, 0.003 * math.sin(2 * math.pi * t / 3))


def load(path, up):
    """The frames of a `.npy` file, z up."""
    try:
        import numpy
    except ImportError:
        sys.exit("reading .npy needs numpy: pip install numpy")
    try:
        frames = numpy.load(path, allow_pickle=False)
    except (OSError, ValueError) as error:
        sys.exit(f"{path}: {error}")
    if frames.ndim != 3 or frames.shape[1:] != (22, 3) or not len(frames):
        sys.exit(f"{path}: shape {frames.shape}, (N, 22, 3) expected")
    if up == "y":
        # x left, y up, z forward (HumanML3D, BVH) to x forward, y left, z up: a rotation.
        frames = frames[:, :, [2, 0, 1]]
    return frames.astype(float).tolist()


def main():
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("motion", nargs="?", help=".npy of shape (N, 22, 3); default: a built-in wave")
    parser.add_argument("--up", choices=("y", "z"), default="y", help="which axis of the file points up")
    parser.add_argument("--rate", type=float, default=60.0, help="frames a second")
    parser.add_argument("--seconds", type=float, help="end after this time, s")
    parser.add_argument("--run-dir", default=DEFAULT_RUN_DIR, help="as `teleopd up --run-dir`")
    arguments = parser.parse_args()
    if not 1 <= arguments.rate <= 240:
        parser.error(f"--rate {arguments.rate}: must be between 1 and 240")
    frames = load(arguments.motion, arguments.up) if arguments.motion else None
    # A script's background jobs ignore SIGINT from the start, and Python then leaves it so.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with SkeletonPublisher(arguments.run_dir) as publisher:
            if lease_is_held(arguments.run_dir):
                print(HELD, flush=True)
            print(f"publishing to {os.path.realpath(arguments.run_dir)}; Ctrl-C ends", flush=True)
            for i in rate(arguments.rate):
                if arguments.seconds is not None and i >= arguments.seconds * arguments.rate:
                    break
                publisher.publish(frames[i % len(frames)] if frames else wave(i, arguments.rate))
    except TeleopdError as error:
        sys.exit(str(error))
    except KeyboardInterrupt:
        pass


if __name__ == "__main__":
    main()
