"""Frames per second of GMR (general motion retargeting) and of this package, in turns on the same frames, each in one thread.

    python tools/peer/gmr.py CHECKOUT [--motion FILE]

CHECKOUT is a clone of github.com/YanjieZe/GMR. It needs teleopd's wheel, and mujoco, mink, scipy, rich, daqp and qpsolvers of PyPI.

What each includes: GMR's `retarget(frame)` scales the person, and solves the whole body of a Unitree G1 with its floating base (29 joints) by
inverse kinematics from the frame before. Ours turns the frames into the postures of both arms of the same robot. Neither knows limits of speed.
GMR keeps limits of position, and ours keeps them, too. Reading of files is in neither.
"""

import argparse
import statistics
import sys
import time
import types
from pathlib import Path

#: GMR takes SMPL-X bodies: x to the left, y up, z forward at rest. Ours are x forward, y left, z up. A quaternion x y z w.
OURS_FROM_SMPLX = (0.5, 0.5, 0.5, 0.5)
#: Frames in a turn of GMR, and turns. An assumption: a few seconds each.
FRAMES, TURNS = 60, 7


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("checkout", type=Path)
    parser.add_argument("--motion", default="builtin")
    args = parser.parse_args()

    import numpy as np
    import teleopd
    from scipy.spatial.transform import Rotation
    from teleopd.lerobot import PERSON

    # The package itself imports torch and cameras, which `retarget` does not need.
    package = types.ModuleType("general_motion_retargeting")
    package.__path__ = [str(args.checkout / "general_motion_retargeting")]
    sys.modules[package.__name__] = package
    from general_motion_retargeting.motion_retarget import GeneralMotionRetargeting

    motion = teleopd.read_motion(args.motion)
    positions, rotations = motion.positions.astype(float), motion.rotations
    assert rotations is not None, "the motion has no rotations"
    turned = Rotation.from_quat(rotations.reshape(-1, 4)) * Rotation.from_quat(OURS_FROM_SMPLX)
    quaternions = turned.as_quat(scalar_first=True).reshape(len(motion), 22, 4)
    frames = [{name: (positions[at, joint], quaternions[at, joint]) for joint, name in enumerate(PERSON)} for at in range(len(motion))]

    gmr = GeneralMotionRetargeting(src_human="smplx", tgt_robot="unitree_g1", actual_human_height=1.75, verbose=False)
    retargeter = teleopd.Retargeter(teleopd.Robot("unitree_g1"))
    gmr.retarget(dict(frames[0]))
    retargeter.retarget(motion)
    rates: dict[str, list[float]] = {"GMR, retarget(frame)": [], "teleopd, retarget(frame)": [], "teleopd, retarget(motion)": []}
    for turn in range(TURNS):
        first = turn * FRAMES % (len(frames) - FRAMES)

        def timed(name, count, work):
            begun = time.perf_counter()
            work()
            rates[name].append(count / (time.perf_counter() - begun))

        timed("GMR, retarget(frame)", FRAMES, lambda: [gmr.retarget(dict(frame)) for frame in frames[first : first + FRAMES]])
        own = range(first, first + FRAMES)
        timed("teleopd, retarget(frame)", FRAMES, lambda: [retargeter.retarget(motion.positions[at], rotations[at]) for at in own])
        timed("teleopd, retarget(motion)", len(motion), lambda: retargeter.retarget(motion))
    base = statistics.median(rates["GMR, retarget(frame)"])
    print(f"{motion.name}: {len(motion)} frames, {TURNS} turns, median (lowest to highest) frames/s")
    for name, values in rates.items():
        middle = statistics.median(values)
        print(f"{name:28} {middle:10.0f} ({min(values):.0f} to {max(values):.0f}), {middle / base:.0f} times GMR")


if __name__ == "__main__":
    main()
