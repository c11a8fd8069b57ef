"""Folders of motions as trajectories that the robot may play, in Parquet, npz or CSV. Parquet needs pyarrow: `pip install pyarrow`.

    python3 -m teleopd.datasets IN OUT --robot tiago_dual

Each motion becomes one file. Its columns are `time_s`, `frame`, `mode`, `clearance_m`, `torque_share`, `motion` and `robot`, and for each
joint JOINT.position_rad, JOINT.velocity_rad_per_s and JOINT.target_rad (or m), so that every reader keeps names, units and robot. A Parquet
file has the same as metadata, too. `manifest.jsonl` in the folder names what each file was made from. So a run that was ended goes on.
"""

from __future__ import annotations

import argparse
import fcntl
import hashlib
import json
import os
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import MODES, Robot, Trajectory, certify, read_motion

#: File formats.
FORMATS = ("parquet", "npz", "csv")
#: Endings of the motion files that are read.
ENDINGS = (".bvh", ".npy", ".npz", ".mcap")
#: Name of the manifest in the output folder.
MANIFEST = "manifest.jsonl"
#: Rows that are written to Parquet at once: a group of 11 MB for 17 joints.
GROUP_ROWS = 1 << 15


def columns(trajectory: Trajectory) -> dict[str, NDArray[Any]]:
    """The columns of a trajectory by their names in a file, without `motion` and `robot`.

        >>> import teleopd
        >>> table = teleopd.datasets.columns(teleopd.certify(teleopd.read_motion("builtin")))
        >>> list(table)[:6]
        ['time_s', 'frame', 'mode', 'clearance_m', 'torque_share', 'torso_lift_joint.position_m']
    """
    robot = trajectory.robot
    table: dict[str, NDArray[Any]] = {
        "time_s": trajectory.time_s, "frame": trajectory.frames, "mode": trajectory.modes,
        "clearance_m": trajectory.clearance_m, "torque_share": trajectory.torque_share,
    }
    for kind, values in (("position_{}", trajectory.positions), ("velocity_{}_per_s", trajectory.velocities), ("target_{}", trajectory.targets)):
        for name, unit, column in zip(robot.joint_names, robot.units, values.T):
            table[f"{name}.{kind.format(unit)}"] = column
    return table


def about(trajectory: Trajectory, **more: Any) -> dict[str, Any]:
    """What a file says of its trajectory beside the columns.

        >>> import teleopd
        >>> teleopd.datasets.about(teleopd.certify(teleopd.read_motion("builtin")))["joints"][:2]
        ['torso_lift_joint', 'head_1_joint']
    """
    robot = trajectory.robot
    return {"motion": trajectory.name, "robot": robot.name, "joints": robot.joint_names, "units": robot.units, "modes": list(MODES),
            "rate_hz": trajectory.rate_hz, "certified": True, "report": trajectory.report, **more}


def write(trajectory: Trajectory, path: str | os.PathLike[str], **more: Any) -> None:
    """Writes a trajectory to a .parquet, .npz or .csv file, which appears as a whole or not at all. more: further metadata of Parquet.

        >>> import teleopd, tempfile
        >>> folder = tempfile.mkdtemp()
        >>> teleopd.datasets.write(teleopd.certify(teleopd.read_motion("builtin")), folder + "/builtin.npz")
        >>> len(teleopd.datasets.read(folder + "/builtin.npz")["time_s"]) > 2000
        True
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        _FORMATS[_format(path.suffix[1:])](trajectory, part, more)
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)


def read(path: str | os.PathLike[str]) -> dict[str, NDArray[Any]]:
    """The columns of a file of `write`, by name.

        >>> import teleopd
        >>> teleopd.datasets.read("motion.xls")
        Traceback (most recent call last):
        ValueError: format = 'xls': must be one of parquet, npz, csv
    """
    path = Path(path)
    if _format(path.suffix[1:]) == "parquet":
        table = _pyarrow("pyarrow.parquet").read_table(path)
        return {name: table[name].to_numpy() for name in table.column_names}
    if path.suffix == ".npz":
        with np.load(path) as stored:
            return dict(stored)
    with path.open() as file:
        names = file.readline().strip().split(",")
        rows = [line.rstrip("\n").split(",") for line in file]
    texts = {name: np.array([row[at] for row in rows]) for at, name in enumerate(names)}
    return {name: column if name in ("motion", "robot") else column.astype(float) for name, column in texts.items()}


def _format(name: str) -> str:
    if name not in FORMATS:
        raise ValueError(f"format = {name!r}: must be one of {', '.join(FORMATS)}")
    return name


def _pyarrow(module: str) -> Any:
    import importlib

    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError("Parquet needs pyarrow: pip install pyarrow", name=error.name) from None


def _write_parquet(trajectory: Trajectory, path: Path, more: dict[str, Any]) -> None:
    pa, pq = _pyarrow("pyarrow"), _pyarrow("pyarrow.parquet")
    table, facts = columns(trajectory), about(trajectory, **more)
    # The second key is that of pandas: it becomes DataFrame.attrs.
    metadata = {"teleopd": json.dumps(facts), "PANDAS_ATTRS": json.dumps({"teleopd": facts})}
    fields = [pa.field(name, pa.from_numpy_dtype(column.dtype), metadata={"unit": name.rpartition(".")[2].partition("_")[2]} if "." in name else None)
              for name, column in table.items()]
    fields += [pa.field(name, pa.string()) for name in ("motion", "robot")]
    schema = pa.schema(fields, metadata=metadata)
    with pq.ParquetWriter(path, schema, compression="zstd") as writer:
        for first in range(0, len(trajectory), GROUP_ROWS):
            rows = slice(first, first + GROUP_ROWS)
            count = len(trajectory.time_s[rows])
            arrays = [pa.array(np.ascontiguousarray(column[rows])) for column in table.values()]
            arrays += [pa.array([text] * count) for text in (trajectory.name, trajectory.robot.name)]
            writer.write_table(pa.Table.from_arrays(arrays, schema=schema))


def _write_npz(trajectory: Trajectory, path: Path, more: dict[str, Any]) -> None:
    texts = {"motion": trajectory.name, "robot": trajectory.robot.name, "about": json.dumps(about(trajectory, **more))}
    arrays: dict[str, Any] = {**columns(trajectory), **texts}
    with path.open("wb") as file:
        np.savez_compressed(file, **arrays)


def _write_csv(trajectory: Trajectory, path: Path, _more: dict[str, Any]) -> None:
    table = columns(trajectory)
    end = f",{trajectory.name},{trajectory.robot.name}\n"
    with path.open("w") as file:
        file.write(",".join([*table, "motion", "robot"]) + "\n")
        for row in zip(*(column.tolist() for column in table.values())):
            file.write(",".join(map(repr, row)) + end)


_FORMATS: dict[str, Callable[[Trajectory, Path, dict[str, Any]], None]] = {"parquet": _write_parquet, "npz": _write_npz, "csv": _write_csv}


@dataclass(frozen=True)
class Options:
    """Everything beside the motion that affects a file."""

    #: the package's robot, or a robot file
    robot: str
    #: a settings file in place of the package's
    settings: str | None
    #: rows per second, a divisor of 1500
    rate_hz: int
    #: source of the elbow hinges
    calibration: str
    #: format of the files
    format: str


@dataclass(frozen=True)
class Outcome:
    """What became of one motion."""

    #: the motion file
    input: str
    #: the trajectory's file
    output: str
    #: "made", "finished" by an earlier run, or "failed"
    state: str
    #: rows of the file
    rows: int = 0
    #: why it failed
    reason: str = ""


@dataclass(frozen=True)
class Report:
    """What became of a folder."""

    #: motions whose file was made by this run, and those that an earlier run had finished
    made: int
    finished: int
    #: rows that this run made
    rows: int
    #: time that it took, s
    seconds: float
    #: reasons by motion file
    failed: dict[str, str] = field(default_factory=dict)

    def __str__(self) -> str:
        rate = self.rows / max(self.seconds, 1e-9)
        lines = [f"{self.made} made with {self.rows} certified rows in {self.seconds:.1f} s ({rate:.0f} a second), "
                 f"{self.finished} were finished, {len(self.failed)} failed"]
        # Most reasons name their file.
        failed = [reason if path in reason else f"{path}: {reason}" for path, reason in sorted(self.failed.items())]
        return "\n".join(lines + [f"failed: {line}" for line in failed])


class Certifier:
    """Makes the file of one motion after the other, and skips what is there. Several may work on one folder, in threads or processes."""

    def __init__(self, out: str | os.PathLike[str], options: Options, overwrite: bool = False) -> None:
        self.out, self.options, self.overwrite = Path(out), options, overwrite
        _format(options.format)
        if options.format == "parquet":
            _pyarrow("pyarrow.parquet")
        self.robot = Robot(options.robot, options.settings)
        # The robot's files and the settings count, too, and what computes.
        parts = [*map(str, asdict(options).values()), self.robot._native.fingerprint]
        self.key = hashlib.sha256("\0".join(parts).encode()).hexdigest()
        self.out.mkdir(parents=True, exist_ok=True)

    def make(self, motion: Path, name: str) -> Outcome:
        """Makes `name` in the folder, without ending."""
        output = self.out / f"{name}.{self.options.format}"
        try:
            source = hashlib.sha256(motion.read_bytes()).hexdigest()
            if not self.overwrite and output.exists():
                entries = [entry for entry in self.entries() if entry["output"] == output.name]
                if any(entry["input_sha256"] == source and entry["options_sha256"] == self.key for entry in entries[-1:]):
                    return Outcome(str(motion), str(output), "finished", entries[-1]["rows"])
                if not entries:
                    raise ValueError(f"{output}: was not written by this tool; overwrite replaces it")
            options = self.options
            trajectory = certify(read_motion(motion), self.robot, rate_hz=options.rate_hz, calibration=options.calibration)
            entry = {"output": output.name, "input": str(motion), "input_sha256": source, "options_sha256": self.key, "rows": len(trajectory)}
            # The line comes first. A run that is killed between the two leaves a line too many, but never an unknown file.
            with self.locked("a") as file:
                file.write(json.dumps(entry) + "\n")
            write(trajectory, output, input=motion.name, input_sha256=source, options=asdict(options))
            return Outcome(str(motion), str(output), "made", len(trajectory))
        except (OSError, ValueError) as error:
            return Outcome(str(motion), str(output), "failed", reason=str(error))

    def entries(self) -> list[dict[str, Any]]:
        """The manifest's lines. A line that was cut short is ignored."""
        found = []
        with self.locked("a+") as file:
            file.seek(0)
            for line in file:
                try:
                    found.append(json.loads(line))
                except ValueError:
                    continue
        return found

    @contextmanager
    def locked(self, mode: str) -> Iterator[Any]:
        with (self.out / MANIFEST).open(mode) as file:
            fcntl.flock(file, fcntl.LOCK_EX)
            yield file


def motions(folder: str | os.PathLike[str]) -> list[tuple[Path, str]]:
    """The motion files of a folder and below it, with the names that their trajectories get. The largest comes first.

        >>> import teleopd, tempfile
        >>> teleopd.datasets.motions(tempfile.mkdtemp())
        Traceback (most recent call last):
        ValueError: ...: no .bvh, .npy, .npz, .mcap in it; give another folder
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise NotADirectoryError(f"{folder}: is not a folder")
    files = [path for path in folder.rglob("*") if path.suffix in ENDINGS and path.is_file()]
    if not files:
        raise ValueError(f"{folder}: no {', '.join(ENDINGS)} in it; give another folder")
    # Below a folder of the same name the endings tell files apart.
    names = {path: "__".join(path.relative_to(folder).with_suffix("").parts) for path in files}
    twice = {name for name in names.values() if list(names.values()).count(name) > 1}
    pairs = [(path, f"{name}{path.suffix.replace('.', '_')}" if name in twice else name) for path, name in names.items()]
    return sorted(pairs, key=lambda pair: (-pair[0].stat().st_size, pair[1]))


def certify_folder(
    folder: str | os.PathLike[str], out: str | os.PathLike[str], *, robot: str = "tiago_dual", settings: str | None = None, rate_hz: int = 100,
    calibration: str = "clip", format: str = "parquet", jobs: int | None = None, overwrite: bool = False,
    progress: Callable[[str], None] | None = None,
) -> Report:
    """Makes a certified trajectory of every motion below a folder, one file each, and only those that are missing.

    A motion that cannot be played stops nothing: the report has its reason. jobs: motions at once, each on one core (default: all cores).
    progress: gets a line after each motion, with what is left. The rows are those of `certify`.

        >>> import teleopd, tempfile
        >>> from pathlib import Path
        >>> folder = Path(tempfile.mkdtemp())
        >>> _ = (folder / "bad.bvh").write_text("no motion")
        >>> report = teleopd.datasets.certify_folder(folder, folder / "out", format="npz")
        >>> report.made, list(report.failed)[0].endswith("bad.bvh")
        (0, True)
    """
    found = motions(folder)
    inside = Path(out).resolve()
    if Path(folder).resolve() == inside:
        raise ValueError(f"out = {out}: is the folder of the motions; give another one")
    found = [(path, name) for path, name in found if inside not in path.resolve().parents]
    certifier = Certifier(out, Options(os.fspath(robot), settings and os.fspath(settings), rate_hz, calibration, format), overwrite)
    begun, done, total = time.monotonic(), 0, sum(path.stat().st_size for path, _ in found)
    outcomes: list[Outcome] = []
    pool = ThreadPoolExecutor(max_workers=jobs or len(os.sched_getaffinity(0)))
    try:
        waiting: dict[Future[Outcome], Path] = {pool.submit(certifier.make, path, name): path for path, name in found}
        for future in as_completed(waiting):
            outcomes.append(future.result())
            done += waiting[future].stat().st_size
            if progress is not None:
                seconds, last = time.monotonic() - begun, outcomes[-1]
                left = seconds * (total - done) / max(done, 1)
                progress(f"{len(outcomes)} of {len(found)} ({last.state} {Path(last.input).name}), about {left:.0f} s left")
    finally:
        # After Ctrl-C the motions in hand are finished, and no other is begun.
        pool.shutdown(cancel_futures=True)
    made = [outcome for outcome in outcomes if outcome.state == "made"]
    failed = {outcome.input: outcome.reason for outcome in outcomes if outcome.state == "failed"}
    return Report(len(made), len(outcomes) - len(made) - len(failed), sum(outcome.rows for outcome in made), time.monotonic() - begun, failed)


def _command(name: str, make: Callable[[], Any]) -> int:
    """Prints what `make` answers, or its error after the command's name. Returns the exit code: 1 if anything failed."""
    try:
        made = make()
    except (OSError, ValueError, ModuleNotFoundError) as error:
        print(f"{name}: {error}", file=sys.stderr)
        return 1
    print(made)
    return 1 if made.failed else 0


def main(arguments: list[str] | None = None) -> int:
    """The command `python3 -m teleopd.datasets`."""
    parser = argparse.ArgumentParser(prog="python3 -m teleopd.datasets", description="Makes trajectories that the robot may play of a folder of motions.")
    parser.add_argument("folder", help="folder of motion files: " + ", ".join(ENDINGS))
    parser.add_argument("out", help="output folder")
    parser.add_argument("--robot", default="tiago_dual", help="a robot of the package, or a robot file")
    parser.add_argument("--settings", help="a settings file in place of the package's")
    parser.add_argument("--rate-hz", type=int, default=100, help="rows per second, a divisor of 1500")
    parser.add_argument("--format", choices=FORMATS, default="parquet")
    parser.add_argument("--jobs", type=int, help="motions at once (default: all cores)")
    parser.add_argument("--overwrite", action="store_true", help="make every file again")
    given = vars(parser.parse_args(arguments))
    given["progress"] = lambda line: print(line, file=sys.stderr)
    return _command("teleopd.datasets", lambda: certify_folder(given.pop("folder"), given.pop("out"), **given))


if __name__ == "__main__":
    sys.exit(main())
