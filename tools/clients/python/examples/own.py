#!/usr/bin/env python3
"""A person in T-pose whose left arm sways up and down, 60 frames a second: where your own tracker's numbers go.

    teleopd up --engage-without-realtime    # terminal 1
    python examples/own.py                  # terminal 2; Ctrl-C ends it
    teleopctl engage                        # terminal 3
"""
import contextlib
import math
import sys

from teleopd_client import DEFAULT_RUN_DIR, SkeletonPublisher, rate

# SMPL-22, metres: x forward, y left, z up. The middle: pelvis, spine 1 to 3, neck, head; then the left half, and the right.
PERSON = {0: (0, 0, .98), 3: (-.01, 0, 1.07), 6: (-.02, 0, 1.17), 9: (-.02, 0, 1.28), 12: (-.04, 0, 1.47), 15: (0, 0, 1.59)}
LEFT = {1: (0, .096, .928), 4: (.018, .096, .499), 7: (0, .096, .068), 10: (.14, .114, .026), 13: (-.03, .053, 1.4),
        16: (-.04, .184, 1.432), 18: (-.04, .51, 1.432), 20: (-.04, .766, 1.432)}
PERSON.update(LEFT)
PERSON.update({i + 1: (x, -y, z) for i, (x, y, z) in LEFT.items()})
run_dir = sys.argv[1] if len(sys.argv) > 1 else DEFAULT_RUN_DIR
with contextlib.suppress(KeyboardInterrupt), SkeletonPublisher.or_exit(run_dir) as publisher:
    print(f"publishing 60 frames a second to {run_dir}; Ctrl-C ends", flush=True)
    for i in rate(60):
        angle = 0.5 * math.sin(2 * math.pi * i / 240)  # rad; a swing takes 4 s
        for joint, length in ((18, .326), (20, .582)):  # elbow and wrist, metres from the shoulder
            PERSON[joint] = (-.04, .184 + length * math.cos(angle), 1.432 + length * math.sin(angle))
        publisher.publish([PERSON[joint] for joint in range(22)])
