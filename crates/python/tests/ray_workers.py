"""Certifies motions by two workers of Ray, and kills one of them.

    ray_workers.py FOLDER REPLAY
"""

import os
import re
import shutil
import signal
import sys
import threading
import time
from pathlib import Path

import numpy as np
import ray
import teleopd

folder = Path(sys.argv[1])
work = folder / "ray"
motions = work / "motions"
motions.mkdir(parents=True)
COUNT = 6
text = (folder / "in/clip.bvh").read_text().splitlines()
first = next(at for at, line in enumerate(text) if line.startswith("Frames:"))
for number in range(COUNT):
    dropped = 5 * number
    head = [*text[:first], f"Frames: {len(text) - first - 2 - dropped}", text[first + 1]]
    (motions / f"{number}.bvh").write_text("\n".join(head + text[first + 2 + dropped :]) + "\n")
(motions / "bad.bvh").write_text("no motion")

os.environ["RAY_DEDUP_LOGS"] = "0"
ray.init(num_cpus=2, include_dashboard=False, log_to_driver=False, object_store_memory=100 * 2**20)
killed = []


def kill():
    """Kills the first worker that has begun a second motion."""
    parts = work / "out"
    while not killed:
        busy = sorted(parts.glob(".*.part")) if parts.exists() else []
        lines = (parts / "manifest.jsonl").read_text().count("\n") if (parts / "manifest.jsonl").exists() else 0
        workers = [int(path.name.split(".")[-2]) for path in busy]
        if lines >= 2 and workers:
            os.kill(workers[0], signal.SIGKILL)
            killed.append(workers[0])
        time.sleep(0.0005)


thread = threading.Thread(target=kill, daemon=True)
thread.start()
paths = ray.data.from_items(teleopd.ray.paths(motions))
outcomes = teleopd.ray.certify(paths, work / "out", workers=2).take_all()
assert killed, "no worker was killed"
states = {Path(row["path"]).name: row["state"] for row in outcomes}
assert len(outcomes) == COUNT + 1 == len(states), states
assert states.pop("bad.bvh") == "failed" and set(states.values()) <= {"made", "finished"}, states
print(f"killed worker {killed[0]} of {sorted({row['pid'] for row in outcomes} | set(killed))}")

# The same rows as without Ray, none twice and none lost.
teleopd.datasets.certify_folder(motions, work / "alone")
for number in range(COUNT):
    a, b = (teleopd.datasets.read(work / place / f"{number}.parquet") for place in ("out", "alone"))
    assert all(np.array_equal(a[name], b[name]) for name in b), number
    assert sum(row["rows"] for row in outcomes if row["path"].endswith(f"/{number}.bvh")) == len(a["time_s"])

# A later run makes nothing.
again = teleopd.ray.certify(paths, work / "out", workers=1).take_all()
assert sorted(row["state"] for row in again) == ["failed"] + ["finished"] * COUNT, again
shutil.rmtree(work / "out")
os.chdir(work)
book = (Path(__file__).resolve().parents[3] / "docs/src/datasets.md").read_text()
block = next(block for block in re.findall(r"```python\n(.*?)```", book, re.S) if "ray.data" in block)
exec(compile(block, "datasets.md", "exec"), {})
