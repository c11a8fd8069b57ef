"""Delay from a person's motion to the robot's, by the peer's clock: publishes a person whose left arm moves up and down.

    peer.py --trace trace.csv ...                         # terminal 1
    teleopd up --config CONFIG                            # terminal 2
    delay.py --trace trace.csv                            # terminal 3, with teleopd_client installed
    teleopctl engage                                      # terminal 4, within the first 15 s
"""

import argparse
import csv
import json
import math
import time
from pathlib import Path

import numpy as np
from teleopd_client import DEFAULT_RUN_DIR, SkeletonPublisher, rate

#: SMPL-22, m: x forward, y left, z up, in a T-pose.
MIDDLE = {0: (0, 0, 0.98), 3: (-0.01, 0, 1.07), 6: (-0.02, 0, 1.17), 9: (-0.02, 0, 1.28), 12: (-0.04, 0, 1.47), 15: (0, 0, 1.59)}
LEFT = {1: (0, 0.096, 0.928), 4: (0.018, 0.096, 0.499), 7: (0, 0.096, 0.068), 10: (0.14, 0.114, 0.026), 13: (-0.03, 0.053, 1.4),
        16: (-0.04, 0.184, 1.432), 18: (-0.04, 0.51, 1.432), 20: (-0.04, 0.766, 1.432)}
RATE_HZ = 60
#: Noise of a tracker: 0.5 mm in `person`.
NOISE = np.random.default_rng(1)
#: Time for the operator to engage, and for the robot to come to the person, s.
SETTLE_S = 15
#: A move takes MOVE_S of each EVERY_S, s. It turns the arm by MOVE_RAD.
MOVE_S, EVERY_S, MOVE_RAD = 0.6, 2.0, 0.6


def share(now_s: float) -> float:
    """Share of the way up, at a time after the first move began. Odd moves lead down."""
    move, since_s = divmod(now_s, EVERY_S)
    way = (1 - math.cos(math.pi * min(since_s / MOVE_S, 1))) / 2
    return way if move % 2 == 0 else 1 - way


def person(turned_rad: float) -> list[tuple[float, float, float]]:
    joints = MIDDLE | LEFT | {i + 1: (x, -y, z) for i, (x, y, z) in LEFT.items()}
    for joint, length in ((18, 0.326), (20, 0.582)):
        joints[joint] = (-0.04, 0.184 + length * math.cos(turned_rad), 1.432 + length * math.sin(turned_rad))
    # A tracker that repeats its numbers counts as frozen.
    return [tuple(x + NOISE.normal(0, 5e-4) for x in joints[joint]) for joint in range(22)]


def publish(run_dir: str, moves: int) -> np.ndarray:
    """Times of the frames and the person's share of the way, rows of (s, share), by the monotonic clock."""
    rows = []
    with SkeletonPublisher.or_exit(run_dir) as publisher:
        for frame in rate(RATE_HZ):
            since_s = frame / RATE_HZ - SETTLE_S
            if since_s > moves * EVERY_S:
                return np.array(rows)
            up = share(since_s) if since_s > 0 else 0.0
            publisher.publish(person(up * MOVE_RAD))
            rows.append((time.monotonic(), up))
    return np.array(rows)


def crossing_s(times_s: np.ndarray, way: np.ndarray) -> float:
    """The time at which a motion from 0 to 1 is half done."""
    after = int(np.argmax(way >= 0.5))
    before = max(after - 1, 0)
    rest = (0.5 - way[before]) / max(way[after] - way[before], 1e-9)
    return float(times_s[before] + rest * (times_s[after] - times_s[before]))


def delays_s(frames: np.ndarray, trace: np.ndarray, moves: int) -> list[float]:
    """Delay of each move at half of its way. A trace has rows of time (s) and joint positions (rad or m)."""
    found = []
    first_s = frames[np.argmax(frames[:, 1] > 0), 0]
    for move in range(moves):
        begin_s = first_s + move * EVERY_S
        of_person = frames[(frames[:, 0] >= begin_s - 0.1) & (frames[:, 0] < begin_s + MOVE_S + 0.1)]
        of_robot = trace[(trace[:, 0] >= begin_s - 0.1) & (trace[:, 0] < begin_s + EVERY_S - 0.1)]
        line = of_robot[-1, 1:] - of_robot[0, 1:]
        if line @ line < 0.01:
            raise SystemExit(f"the robot did not make move {move}: is it engaged?")
        way = (of_robot[:, 1:] - of_robot[0, 1:]) @ line / (line @ line)
        up = of_person[:, 1] if move % 2 == 0 else 1 - of_person[:, 1]
        found.append(crossing_s(of_robot[:, 0], way) - crossing_s(of_person[:, 0], up))
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trace", type=Path, required=True, help="the file of the running peer")
    parser.add_argument("--run-dir", default=DEFAULT_RUN_DIR, help="folder of the running instance")
    parser.add_argument("--moves", type=int, default=60, help="number of moves, one each 2 s")
    args = parser.parse_args()
    frames = publish(args.run_dir, args.moves)
    time.sleep(0.5)
    rows = list(csv.reader(args.trace.open()))
    measured = [0] + [i for i, name in enumerate(rows[0]) if name.endswith(".measured")]
    trace = np.array([[float(row[i]) for i in measured] for row in rows[1:-1]])
    found_ms = 1e3 * np.array(delays_s(frames, trace, args.moves))
    print(json.dumps({"moves": args.moves, "p50_ms": round(float(np.median(found_ms)), 1),
                      "p99_ms": round(float(np.percentile(found_ms, 99)), 1), "max_ms": round(float(found_ms.max()), 1)}))


if __name__ == "__main__":
    main()
