"""Exports recordings as a LeRobot dataset, and reads its files by pyarrow alone. With --reload also by lerobot.

    lerobot_files.py FOLDER REPLAY [--reload]
"""

import json
import os
import re
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import teleopd
from refusals import refused
from teleopd import lerobot

folder = Path(sys.argv[1])
recording = folder / "out.mcap"
run = [sys.argv[2], folder / "in/clip.bvh", "--offline", folder / "out.csv", "--record", recording]
subprocess.run(list(map(str, run)), check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
out = folder / "lerobot"


def column(table, name):
    values = table[name].combine_chunks()
    return values.flatten().to_numpy().reshape(len(table), -1) if values.type.num_fields else values.to_numpy()


FPS = 30
(folder / "bad.mcap").write_text("no recording")
exported = lerobot.export([recording, folder / "bad.mcap", recording], out, fps=FPS)
assert exported.episodes == 2 and list(exported.failed) == [str(folder / "bad.mcap")], exported
info = json.loads((out / "meta/info.json").read_text())
assert info["codebase_version"] == "v3.0" and info["fps"] == FPS and info["robot_type"] == "tiago_dual"
assert info["total_frames"] == exported.frames and info["total_episodes"] == 2 and info["splits"] == {"train": "0:2"}

# The schema is what the features say.
table = pq.read_table(out / "data/chunk-000/file-000.parquet")
for name, feature in info["features"].items():
    kind, width = table.schema.field(name).type, feature["shape"][0]
    assert width == 1 or kind.list_size == width, (name, kind)
    assert str(kind if width == 1 else kind.value_type) == {"float32": "float", "int64": "int64"}[feature["dtype"]], (name, kind)
    assert feature["names"] is None or len(feature["names"]) == width, name
assert set(table.column_names) == set(info["features"])

# The arrays are those of the recording: the first message of each period.
read = teleopd.read_recording(recording)
commands, states, targets = (read.messages[kind] for kind in ("commands", "states", "targets"))
half = len(table) // 2
actions, times = column(table, "action")[:half], column(table, "source")[:half, 1]
origin_ns = min(int(each["time_ns"][0]) for each in read.messages.values())
at = np.searchsorted(commands["time_ns"], origin_ns + times * 1000)
assert np.array_equal(actions, commands["positions"][at].astype(np.float32))
assert np.array_equal(column(table, "mode")[:half], commands["modes"][at])
led_by = column(table, "source")[:half, 2]
assert np.array_equal(led_by, commands["sources"][at]) and set(led_by) == {0, 3}, set(led_by)
steps = np.diff(commands["k"][at].astype(int))
assert np.all(steps == 1500 // FPS), np.unique(steps)
measured = states["measured_positions"][np.searchsorted(states["time_ns"], commands["time_ns"][at])]
assert np.abs(column(table, "observation.state")[:half] - measured).max() < 5e-3
wanted = targets["positions"][np.searchsorted(targets["time_ns"], commands["time_ns"][at])]
assert np.abs(column(table, "target")[:half] - wanted).max() < 2e-2
assert column(table, "person").shape == (len(table), 66) and np.ptp(column(table, "person"), axis=0).max() > 0.1
assert np.array_equal(actions, column(table, "action")[half:])
assert len({teleopd.MODES[mode] for mode in column(table, "mode")}) >= 2

# Indices, stamps, episodes, statistics, tasks.
assert np.array_equal(column(table, "index"), np.arange(len(table)))
assert np.array_equal(column(table, "timestamp"), np.float32(column(table, "frame_index") / FPS))
episodes = pq.read_table(out / "meta/episodes/chunk-000/file-000.parquet").to_pylist()
assert [row["length"] for row in episodes] == [half, half] and episodes[1]["dataset_from_index"] == half and episodes[1]["dataset_to_index"] == len(table)
assert np.allclose(episodes[0]["stats/action/mean"], actions.mean(0), atol=1e-5) and episodes[0]["tasks"] == ["follow the person"]
stats = json.loads((out / "meta/stats.json").read_text())
assert np.allclose(stats["action"]["q99"], np.quantile(column(table, "action").astype(float), 0.99, axis=0)) and stats["action"]["count"] == [len(table)]
tasks = pq.read_table(out / "meta/tasks.parquet")
assert json.loads(tasks.schema.metadata[b"pandas"])["index_columns"] == ["task"] and tasks["task"].to_pylist() == ["follow the person"]

# An hour: stamps stay on the grid within LeRobot's tolerance, and it takes less than a fiftieth of the time.
hour = 3600
ticks = {"commands": 60, "states": 60, "targets": 60, "skeletons": 60}
rows = {kind: np.arange(hour * rate) for kind, rate in ticks.items()}
repeated = {
    kind: {name: np.repeat(values[:1], len(rows[kind]), axis=0) for name, values in read.messages[kind].items()}
    | {"time_ns": np.uint64(origin_ns) + (rows[kind] * 1_000_000_000 // ticks[kind]).astype(np.uint64)}
    for kind in ticks
}
repeated["commands"]["positions"] = np.sin(rows["commands"][:, None] / 600 + np.arange(17))
long = teleopd.Recording(repeated, {"robot": "tiago_dual"}, None)
original, lerobot.read_recording = lerobot.read_recording, lambda path, rate_hz: long
begun = time.monotonic()
exported = lerobot.export("hour.mcap", folder / "hour", fps=FPS)
seconds = time.monotonic() - begun
print(f"an hour at {FPS} Hz was exported in {seconds:.1f} s, {hour / seconds:.0f} times real time, without reading the recording")
assert exported.frames >= hour * FPS - 3 and exported.episodes == 4, exported
table = pq.read_table(folder / "hour/data/chunk-000/file-000.parquet")
stamps = column(table, "timestamp").astype(float)
assert np.abs(stamps - column(table, "frame_index") / FPS).max() < lerobot.TOLERANCE_S
for episode in range(4):
    own = stamps[column(table, "episode_index") == episode]
    assert np.abs(np.diff(own) - 1 / FPS).max() < lerobot.TOLERANCE_S
# A rate of a power of two has exact stamps, so the hour is one episode.
assert lerobot.export("hour.mcap", folder / "exact", fps=32).episodes == 1

# A pause ends an episode, and nothing is made up.
kept = np.abs(rows["commands"] - 60 * 900) > 60
for kind in ("commands", "states"):
    repeated[kind] = {name: values[kept] for name, values in repeated[kind].items()}
exported = lerobot.export("hour.mcap", folder / "paused", fps=32)
assert exported.episodes == 2 and hour * 32 - 75 < exported.frames < hour * 32 - 55, exported
lerobot.read_recording = original

# Errors.
refused(FileExistsError, ["lerobot", "exists"], lambda: lerobot.export(recording, out))
refused(ValueError, ["fps = 0"], lambda: lerobot.export(recording, folder / "x", fps=0))
refused(ValueError, ["not unitree_g1", "tiago_dual"], lambda: lerobot.export(recording, folder / "x", robot="unitree_g1"))
refused(ValueError, ["bad.mcap"], lambda: lerobot.export(folder / "bad.mcap", folder / "x"))

# The book's lines.
book = (Path(__file__).resolve().parents[3] / "docs/src/datasets.md").read_text()
block = next(block for block in re.findall(r"```python\n(.*?)```", book, re.S) if "lerobot.export" in block)
os.chdir(folder)
exec(compile(block, "datasets.md", "exec"), {})

if "--reload" in sys.argv:
    import importlib.metadata

    import torch
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    dataset = LeRobotDataset("teleopd/demo", root=out)
    table = pq.read_table(out / "data/chunk-000/file-000.parquet")
    assert len(dataset) == len(table) and dataset.num_episodes == 2
    names = ("observation.state", "action", "target", "person", "mode", "source", "timestamp")
    for index in (0, 1, half - 1, half, len(table) - 1):
        for name in names:
            assert np.array_equal(dataset[index][name].numpy(), column(table, name)[index]), (index, name)
    assert dataset[0]["task"] == "follow the person"
    windows = {"action": [0.0, 1 / FPS, 2 / FPS], "observation.state": [-1 / FPS, 0.0]}
    dataset = LeRobotDataset("teleopd/demo", root=out, delta_timestamps=windows)
    actions, states = column(table, "action"), column(table, "observation.state")
    for index in (1, 17, half + 5):
        assert np.array_equal(dataset[index]["action"].numpy(), actions[index : index + 3])
        assert np.array_equal(dataset[index]["observation.state"].numpy(), states[index - 1 : index + 1])
    assert dataset[half - 1]["action_is_pad"].tolist() == [False, True, True]
    batch = next(iter(torch.utils.data.DataLoader(dataset, batch_size=8)))
    assert batch["action"].shape == (8, 3, 17)
    long = LeRobotDataset("teleopd/hour", root=folder / "hour")
    frame = long[3000 * FPS]
    assert long.num_episodes == 4 and abs(float(frame["timestamp"]) - int(frame["frame_index"]) / FPS) < long.tolerance_s
    versions = {package: importlib.metadata.version(package) for package in ("lerobot", "torch", "datasets", "pyarrow", "numpy")}
    print(f"LeRobotDataset read {len(dataset)} frames of 2 episodes, by index and by delta_timestamps, equal to the files")
    print(", ".join(f"{package} {version}" for package, version in versions.items()))
