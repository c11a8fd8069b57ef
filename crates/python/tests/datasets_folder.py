"""Certifies a folder of motions, and reads the files by other libraries.

    datasets_folder.py FOLDER REPLAY
"""

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import duckdb
import numpy as np
import pandas
import polars
import pyarrow.parquet
import teleopd
from refusals import refused

folder, replay = Path(sys.argv[1]), sys.argv[2]
work = folder / "datasets"
motions = work / "motions"
(motions / "more").mkdir(parents=True)
shutil.copy(folder / "in/clip.bvh", motions / "a.bvh")
text = (folder / "in/clip.bvh").read_text().splitlines()
first = next(at for at, line in enumerate(text) if line.startswith("Frames:"))
text[first] = f"Frames: {len(text) - first - 2 - 40}"
(motions / "more/b.bvh").write_text("\n".join(text[: first + 2] + text[first + 42 :]) + "\n")
(motions / "bad.bvh").write_text("no motion")


# One bad file stops nothing.
lines = []
report = teleopd.datasets.certify_folder(motions, work / "out", progress=lines.append)
assert (report.made, report.finished, len(report.failed)) == (2, 0, 1), report
assert "no motion" in (motions / "bad.bvh").read_text() and "bad.bvh" in str(report)
assert len(lines) == 3 and lines[-1].startswith("3 of 3") and "s left" in lines[-1], lines
assert sorted(path.name for path in (work / "out").iterdir()) == ["a.parquet", "manifest.jsonl", "more__b.parquet"]

# The rows are those of `certify` and of `replay batch --certified`.
robot = teleopd.Robot()
trajectory = teleopd.certify(teleopd.read_motion(motions / "a.bvh"), robot)
table = teleopd.datasets.read(work / "out/a.parquet")
positions = np.stack([table[f"{name}.position_{unit}"] for name, unit in zip(robot.joint_names, robot.units)], axis=1)
assert np.array_equal(positions, trajectory.positions)
assert np.array_equal(table["frame"], trajectory.frames) and np.array_equal(table["time_s"], trajectory.time_s)
assert set(table["robot"]) == {"tiago_dual"} and set(table["motion"]) == {trajectory.name}
batch = [replay, "batch", "--certified", "--format", "npz", "--recursive", "--input", motions, "--out", work / "batch"]
subprocess.run(list(map(str, batch)), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
assert np.array_equal(np.load(work / "batch/a.npz")["q"][::15], positions)

# Limits, by differences of what stands in the file.
assert np.all(positions >= robot.limits["position_min"]) and np.all(positions <= robot.limits["position_max"])
speed = np.abs(np.diff(positions, axis=0) / np.diff(table["time_s"])[:, None])
assert np.all(speed <= robot.limits["velocity"] * (1 + 1e-6)) and speed.max() > 0.1

# Only what is missing is made: nothing, one that was lost, one whose motion has changed, and all at another rate.
again = teleopd.datasets.certify_folder(motions, work / "out")
assert (again.made, again.finished) == (0, 2), again
(work / "out/a.parquet").unlink()
with (work / "out/manifest.jsonl").open("a") as file:
    file.write('{"output": "cut')
again = teleopd.datasets.certify_folder(motions, work / "out")
assert (again.made, again.finished) == (1, 1), again
shutil.copy(motions / "more/b.bvh", motions / "a.bvh")
again = teleopd.datasets.certify_folder(motions, work / "out", jobs=1)
assert (again.made, again.finished) == (1, 1), again
assert np.array_equal(teleopd.datasets.read(work / "out/a.parquet")["frame"], teleopd.datasets.read(work / "out/more__b.parquet")["frame"])
again = teleopd.datasets.certify_folder(motions, work / "out", rate_hz=50)
assert (again.made, again.finished) == (2, 0), again
(work / "foreign").mkdir()
(work / "foreign/a.parquet").write_text("mine")
foreign = teleopd.datasets.certify_folder(motions, work / "foreign")
assert "was not written by this tool" in str(foreign) and (work / "foreign/a.parquet").read_text() == "mine"

# Other formats have the same columns.
for kind in ("npz", "csv"):
    teleopd.datasets.certify_folder(motions, work / kind, format=kind, rate_hz=50)
    other, parquet = teleopd.datasets.read(work / f"{kind}/a.{kind}"), teleopd.datasets.read(work / "out/a.parquet")
    assert set(parquet) <= set(other), kind
    assert all(np.array_equal(parquet[name], other[name]) for name in parquet if name not in ("motion", "robot")), kind
    assert str(np.unique(other["robot"])[0]) == "tiago_dual"

# Every reader keeps names, units and robot.
path, facts = str(work / "out/a.parquet"), None
name = "arm_left_1_joint.velocity_rad_per_s"
schema = pyarrow.parquet.read_schema(path)
facts = json.loads(schema.metadata[b"teleopd"])
assert facts["robot"] == "tiago_dual" and facts["units"] == robot.units and facts["rate_hz"] == 50 and facts["certified"]
assert schema.field(name).metadata[b"unit"] == b"rad_per_s" and schema.field("torso_lift_joint.position_m").metadata[b"unit"] == b"m"
frame = pandas.read_parquet(path)
assert frame.attrs["teleopd"] == facts and frame["robot"].iloc[0] == "tiago_dual" and name in frame
frame = polars.read_parquet(path)
assert json.loads(polars.read_parquet_metadata(path)["teleopd"]) == facts
assert frame["robot"][0] == "tiago_dual" and name in frame.columns
kept = duckdb.sql(f"SELECT decode(value) FROM parquet_kv_metadata('{path}') WHERE decode(key) = 'teleopd'").fetchall()
assert json.loads(kept[0][0]) == facts
fastest = duckdb.sql(f"SELECT motion, robot, max(abs(\"{name}\")) FROM '{work}/out/*.parquet' GROUP BY ALL").fetchall()
assert len(fastest) == 2 and all(robot == "tiago_dual" and speed > 0 for _, robot, speed in fastest)
import datasets  # the library of Hugging Face

rows = datasets.Dataset.from_parquet(path, cache_dir=str(work / "cache"))
assert rows[0]["robot"] == "tiago_dual" and name in rows.features and rows.num_rows == len(frame)

# The book's lines, in a folder with motions.
book = (Path(__file__).resolve().parents[3] / "docs/src/datasets.md").read_text()
import os

os.chdir(work)
blocks = [block for block in re.findall(r"```python\n(.*?)```", book, re.S) if "certify_folder" in block or "read_parquet" in block]
assert len(blocks) == 2, len(blocks)
for block in blocks:
    exec(compile(block.replace("from_items", "skip"), "datasets.md", "exec"), {})

# Errors name what is wrong, and a way out.
refused(ValueError, ["format = 'xls'", "parquet, npz, csv"], lambda: teleopd.datasets.certify_folder(motions, work / "x", format="xls"))
refused(ValueError, ["is the folder of the motions"], lambda: teleopd.datasets.certify_folder(motions, motions))
refused(OSError, ["none", "is not a folder"], lambda: teleopd.datasets.certify_folder(work / "none", work / "x"))
assert teleopd.datasets.main([str(motions), str(work / "out"), "--rate-hz", "50"]) == 1
