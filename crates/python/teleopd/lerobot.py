"""Recordings as a LeRobot dataset of version 3. It needs pyarrow: `pip install pyarrow`.

    python3 -m teleopd.lerobot demo.mcap --out dataset

A frame has the first message of each kind in its period, or the newest before it:

- `observation.state`: measured positions, rad or m
- `action`: commanded positions, which are certified
- `target`: what the person asked for
- `policy`: what a policy asked for, zeros before it did
- `person`: positions of SMPL-22, x y z of each joint, m, zeros where nobody was seen
- `mode`: a number of `teleopd.MODES`
- `source`: number of the person who was seen, the command's time in the recording, us since its first message, and who led: the sum of 1 (a
  person the left arm), 2 (a person the right one), 4 (a policy the left arm) and 8 (a policy the right one)

Stamps are frame / fps, rounded once. Where a recording pauses, an episode ends.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import Recording, Robot, read_recording
from .datasets import _command, _pyarrow

#: Version of the layout.
VERSION = "v3.0"
#: Tolerance with which LeRobot compares stamps by default, s.
TOLERANCE_S = 1e-4
#: Longest pause within an episode, s. An assumption: three frames of the slowest camera.
PAUSE_MAX_S = 0.1
#: Frames of the shortest episode. An assumption: a single frame has no motion.
FRAMES_MIN = 2
#: Frames of a data file: 100 MB for 17 joints, as LeRobot has it.
FILE_FRAMES = 200_000
#: Quantiles of the statistics.
QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}
#: Joints of SMPL-22.
PERSON = (
    "pelvis", "left_hip", "right_hip", "spine1", "left_knee", "right_knee", "spine2", "left_ankle", "right_ankle", "spine3", "left_foot",
    "right_foot", "neck", "left_collar", "right_collar", "head", "left_shoulder", "right_shoulder", "left_elbow", "right_elbow", "left_wrist",
    "right_wrist",
)


@dataclass(frozen=True)
class Exported:
    """What `export` wrote."""

    #: the folder
    out: Path
    #: number of episodes and of frames
    episodes: int
    frames: int
    #: recordings of which nothing was written, and why
    failed: dict[str, str]

    def __str__(self) -> str:
        lines = [f"{self.episodes} episodes with {self.frames} frames in {self.out}"]
        # Most reasons name their file.
        return "\n".join(lines + [f"failed: {reason if path in reason else f'{path}: {reason}'}" for path, reason in self.failed.items()])


def _periods(time_ns: NDArray[np.uint64], fps: int) -> NDArray[np.int64]:
    """The number of the period in which each message stands, as `read_recording` counts them."""
    seconds, rest = np.divmod(time_ns.astype(np.int64), 1_000_000_000)
    numbers: NDArray[np.int64] = seconds * fps + (rest + 1) * fps // 1_000_000_000
    return numbers


def _newest(values: NDArray[Any], at: NDArray[np.int64]) -> NDArray[Any]:
    """Rows by their number, zeros for a negative one: before the first message."""
    rows = np.zeros((len(at), *values.shape[1:]), values.dtype)
    rows[at >= 0] = values[at[at >= 0]]
    return rows


def _frames(recording: Recording, fps: int) -> list[dict[str, NDArray[Any]]]:
    """The episodes of a recording that was read at `fps`: columns by name."""
    messages = recording.messages
    lacking = [kind for kind in ("states", "commands", "targets") if kind not in messages]
    if lacking:
        raise ValueError(f"has no {' and no '.join(lacking)}; record a session in which the robot is led")
    # A policy leads without a person, who may come later.
    none = {"time_ns": np.zeros(0, np.uint64), "positions": np.zeros((0, 22, 3)), "operator_id": np.zeros(0, np.uint64)}
    joints = messages["commands"]["positions"].shape[1]
    messages = {"skeletons": none, "policy_targets": {**none, "positions": np.zeros((0, joints))}, **messages}
    kinds = ("states", "commands", "targets", "skeletons", "policy_targets")
    periods = {kind: _periods(messages[kind]["time_ns"], fps) for kind in kinds}
    # The first period is cut short.
    first, last = max(periods[kind][0] for kind in ("states", "commands", "targets")) + 1, min(periods[kind][-1] for kind in ("states", "commands"))
    grid = np.arange(first, last + 1)
    newest = {kind: np.searchsorted(at, grid, side="right") - 1 for kind, at in periods.items()}
    # A frame needs what the robot did and was sent. The person may be away: then the robot holds, and says so by its mode.
    age = np.max([grid - periods[kind][newest[kind]] for kind in ("states", "commands")], axis=0)
    usable = age <= max(1, int(PAUSE_MAX_S * fps))
    edges = np.flatnonzero(np.diff(np.concatenate([[False], usable, [False]])))
    origin_ns = min(int(table["time_ns"][0]) for table in messages.values() if len(table["time_ns"]))
    # LeRobot keeps stamps as 32-bit floats. In a longer episode the steps between them would leave its tolerance.
    steps_s = np.diff((np.arange(len(grid)) / fps).astype(np.float32).astype(np.float64))
    outside = np.flatnonzero(np.abs(steps_s - 1.0 / fps) > 0.9 * TOLERANCE_S)
    longest = int(outside[0]) + 1 if len(outside) else len(grid)
    episodes: list[dict[str, NDArray[Any]]] = []
    for begin, end in edges.reshape(-1, 2):
        for start in range(begin, end, longest):
            stop = min(end, start + longest)
            if stop - start < FRAMES_MIN:
                continue
            at = {kind: indices[start:stop] for kind, indices in newest.items()}
            command_us = (messages["commands"]["time_ns"][at["commands"]].astype(np.int64) - origin_ns) // 1000
            led_by = messages["commands"]["sources"][at["commands"]].astype(np.int64)
            operator = _newest(messages["skeletons"]["operator_id"], at["skeletons"])
            episodes.append({
                "observation.state": messages["states"]["measured_positions"][at["states"]].astype(np.float32),
                "action": messages["commands"]["positions"][at["commands"]].astype(np.float32),
                "target": messages["targets"]["positions"][at["targets"]].astype(np.float32),
                "policy": _newest(messages["policy_targets"]["positions"], at["policy_targets"]).astype(np.float32),
                "person": _newest(messages["skeletons"]["positions"], at["skeletons"]).reshape(stop - start, -1).astype(np.float32),
                "mode": messages["commands"]["modes"][at["commands"]].astype(np.int64),
                "source": np.stack([operator.astype(np.int64), command_us, led_by], axis=1),
                "timestamp": (np.arange(stop - start) / fps).astype(np.float32),
                "frame_index": np.arange(stop - start),
            })
    return episodes


def _statistics(column: NDArray[Any]) -> dict[str, list[float] | list[int]]:
    values = column.reshape(len(column), -1).astype(np.float64)
    found: dict[str, Any] = {"min": values.min(0), "max": values.max(0), "mean": values.mean(0), "std": values.std(0)}
    found.update(zip(QUANTILES, np.quantile(values, list(QUANTILES.values()), axis=0)))
    return {**{name: value.tolist() for name, value in found.items()}, "count": [len(column)]}


def _features(robot: Robot) -> dict[str, dict[str, Any]]:
    joints = {"dtype": "float32", "shape": [len(robot.joint_names)], "names": robot.joint_names}
    person = [f"{joint}.{axis}" for joint in PERSON for axis in "xyz"]
    one = {"shape": [1], "names": None}
    return {
        "observation.state": joints, "action": joints, "target": joints, "policy": joints,
        "person": {"dtype": "float32", "shape": [66], "names": person},
        "mode": {"dtype": "int64", **one},
        "source": {"dtype": "int64", "shape": [3], "names": ["operator_id", "recording_time_us", "led_by"]},
        "timestamp": {"dtype": "float32", **one},
        **{name: {"dtype": "int64", **one} for name in ("frame_index", "episode_index", "index", "task_index")},
    }


def _column(values: NDArray[Any]) -> Any:
    pa = _pyarrow("pyarrow")
    flat = pa.array(np.ascontiguousarray(values).reshape(-1))
    return flat if values.ndim == 1 else pa.FixedSizeListArray.from_arrays(flat, values.shape[1])


def _tasks(task: str) -> Any:
    """The table of tasks as pandas writes it: its text is the index."""
    pa = _pyarrow("pyarrow")
    kinds = (("task_index", "int64", "int64"), ("task", "unicode", "object"))
    described = {"index_columns": ["task"], "column_indexes": [], "pandas_version": "2.0.0",
                 "columns": [{"name": name, "field_name": name, "pandas_type": kind, "numpy_type": stored, "metadata": None}
                             for name, kind, stored in kinds]}
    table = pa.table({"task_index": pa.array([0], pa.int64()), "task": pa.array([task])})
    return table.replace_schema_metadata({"pandas": json.dumps(described)})


class _Writer:
    """Episodes after each other, in files of bounded size."""

    def __init__(self, out: Path, robot: Robot, fps: int, task: str) -> None:
        self.out, self.robot, self.fps, self.task = out, robot, fps, task
        self.rows: list[dict[str, Any]] = []
        self.frames, self.file, self.file_frames = 0, 0, 0
        self.writer: Any = None
        self.seen: dict[str, list[NDArray[Any]]] = {}

    def episode(self, columns: dict[str, NDArray[Any]], recording: str) -> None:
        pa, pq = _pyarrow("pyarrow"), _pyarrow("pyarrow.parquet")
        count, number = len(columns["timestamp"]), len(self.rows)
        columns = {**columns, "episode_index": np.full(count, number), "index": np.arange(self.frames, self.frames + count),
                   "task_index": np.zeros(count, np.int64)}
        if self.writer is not None and self.file_frames + count > FILE_FRAMES:
            self.writer.close()
            self.writer, self.file, self.file_frames = None, self.file + 1, 0
        table = pa.table({name: _column(values) for name, values in columns.items()})
        if self.writer is None:
            self.writer = pq.ParquetWriter(self._place("data", self.file), table.schema, compression="snappy")
        self.writer.write_table(table, row_group_size=count)
        row = {"episode_index": number, "tasks": [self.task], "length": count, "data/chunk_index": self.file // 1000,
               "data/file_index": self.file % 1000, "dataset_from_index": self.frames, "dataset_to_index": self.frames + count,
               "recording": recording}
        for name, values in columns.items():
            row.update({f"stats/{name}/{statistic}": value for statistic, value in _statistics(values).items()})
            self.seen.setdefault(name, []).append(values)
        self.rows.append({**row, "meta/episodes/chunk_index": 0, "meta/episodes/file_index": 0})
        self.frames, self.file_frames = self.frames + count, self.file_frames + count

    def _place(self, folder: str, file: int) -> Path:
        path = self.out / folder / f"chunk-{file // 1000:03d}" / f"file-{file % 1000:03d}.parquet"
        path.parent.mkdir(parents=True, exist_ok=True)
        return path

    def finish(self) -> None:
        pa, pq = _pyarrow("pyarrow"), _pyarrow("pyarrow.parquet")
        if self.writer is not None:
            self.writer.close()
        pq.write_table(pa.Table.from_pylist(self.rows), self._place("meta/episodes", 0), compression="snappy")
        pq.write_table(_tasks(self.task), self.out / "meta/tasks.parquet")
        # LeRobot wants the quantiles of all frames, and those of episodes cannot be joined.
        statistics = {name: _statistics(np.concatenate(parts)) for name, parts in self.seen.items()}
        (self.out / "meta/stats.json").write_text(json.dumps(statistics, indent=4))
        chunked = "chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
        (self.out / "meta/info.json").write_text(json.dumps({
            "codebase_version": VERSION, "robot_type": self.robot.name, "total_episodes": len(self.rows), "total_frames": self.frames,
            "total_tasks": 1, "chunks_size": 1000, "data_files_size_in_mb": 100, "video_files_size_in_mb": 200, "fps": self.fps,
            "splits": {"train": f"0:{len(self.rows)}"}, "data_path": "data/" + chunked, "video_path": None, "features": _features(self.robot),
        }, indent=4))


def export(
    recordings: str | os.PathLike[str] | Iterable[str | os.PathLike[str]], out: str | os.PathLike[str], *, robot: Robot | str | None = None,
    fps: int = 30, task: str = "follow the person",
) -> Exported:
    """Writes recordings as a LeRobot dataset into the folder `out`, which must not exist.

    robot: by default that of the recordings. fps: frames per second. task: the text that goes with every frame. A recording that cannot be
    read stops nothing: the result has its reason. Raises ValueError if no recording has a frame.

        >>> import teleopd
        >>> teleopd.lerobot.export(["none.mcap"], "dataset")
        Traceback (most recent call last):
        ValueError: none.mcap: there is no such file. Check the path; it is relative to the current folder
    """
    _pyarrow("pyarrow.parquet")
    paths = [recordings] if isinstance(recordings, (str, os.PathLike)) else list(recordings)
    if not 1 <= fps <= 1500 or int(fps) != fps:
        raise ValueError(f"fps = {fps}: must be a whole number within [1, 1500] Hz")
    out = Path(out)
    if out.exists():
        raise FileExistsError(f"{out}: exists; give another folder")
    chosen = robot if isinstance(robot, Robot) or robot is None else Robot(robot)
    writer: _Writer | None = None
    failed: dict[str, str] = {}
    for path in [os.fspath(path) for path in paths]:
        try:
            recording = read_recording(path, rate_hz=fps)
            name = recording.about.get("robot", "")
            chosen = chosen or Robot(name)
            if name not in ("", chosen.name):
                raise ValueError(f"{path}: the robot is {name}, not {chosen.name}; a dataset has one robot")
            episodes = _frames(recording, fps)
            if not episodes:
                raise ValueError(f"{path}: has no two frames at {fps} Hz")
        except (OSError, ValueError) as error:
            failed[path] = str(error)
            continue
        writer = writer or _Writer(out, chosen, int(fps), task)
        for columns in episodes:
            writer.episode(columns, Path(path).name)
    if writer is None:
        reasons = list(dict.fromkeys(failed.values()))
        more = f"; and {len(reasons) - 3} more reasons" if len(reasons) > 3 else ""
        raise ValueError("; ".join(reasons[:3]) + more if reasons else "recordings: none given")
    writer.finish()
    return Exported(out, len(writer.rows), writer.frames, failed)


def main(arguments: list[str] | None = None) -> int:
    """The command `python3 -m teleopd.lerobot`."""
    parser = argparse.ArgumentParser(prog="python3 -m teleopd.lerobot", description="Writes recordings as a LeRobot dataset.")
    parser.add_argument("recordings", nargs="+", help="recordings of record, demo --record or replay --record")
    parser.add_argument("--out", required=True, help="the dataset's folder, which must not exist")
    parser.add_argument("--robot", help="a robot of the package, or a robot file (default: that of the recordings)")
    parser.add_argument("--fps", type=int, default=30, help="frames per second")
    parser.add_argument("--task", default="follow the person", help="the text that goes with every frame")
    given = vars(parser.parse_args(arguments))
    return _command("teleopd.lerobot", lambda: export(given.pop("recordings"), given.pop("out"), **given))


if __name__ == "__main__":
    sys.exit(main())
