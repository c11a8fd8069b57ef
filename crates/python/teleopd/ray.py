"""Certified trajectories by Ray Data, where one machine is too small. It needs Ray: `pip install "ray[data]"`.

    import ray, teleopd
    paths = ray.data.from_items(teleopd.ray.paths("motions"))
    print(teleopd.ray.certify(paths, "out").take_all())

Every worker has the robot once, and makes one motion at a time on one core. The files are those of `teleopd.datasets.certify_folder`, and so
is the manifest: what is there is not made again, in this run or in a later one. The folder must be the same for all workers, and its file
system must have locks.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .datasets import Certifier, Options, motions


def paths(folder: str | os.PathLike[str]) -> list[dict[str, str]]:
    """The motions of a folder as items for `ray.data.from_items`: their paths, and the names that their files get.

        >>> import teleopd, tempfile
        >>> teleopd.ray.paths(tempfile.mkdtemp())
        Traceback (most recent call last):
        ValueError: ...: no .bvh, .npy, .npz, .mcap in it; give another folder
    """
    return [{"path": str(path.resolve()), "name": name} for path, name in motions(folder)]


class Certify:
    """Certifies the motions of a batch, for `Dataset.map_batches`: it takes rows with `path` and `name`, and gives their outcomes.

        >>> import teleopd, tempfile
        >>> worker = teleopd.ray.Certify(tempfile.mkdtemp(), format="npz")
        >>> worker({"path": ["none.bvh"], "name": ["none"]})["state"].tolist()
        ['failed']
    """

    def __init__(
        self, out: str, robot: str = "tiago_dual", settings: str | None = None, rate_hz: int = 100, calibration: str = "clip", format: str = "parquet",
    ) -> None:
        self.certifier = Certifier(out, Options(robot, settings, rate_hz, calibration, format))

    def __call__(self, batch: Mapping[str, Any]) -> dict[str, NDArray[Any]]:
        outcomes = [self.certifier.make(Path(str(path)), str(name)) for path, name in zip(batch["path"], batch["name"])]
        return {
            "path": np.array([outcome.input for outcome in outcomes]), "output": np.array([outcome.output for outcome in outcomes]),
            "state": np.array([outcome.state for outcome in outcomes]), "rows": np.array([outcome.rows for outcome in outcomes]),
            "reason": np.array([outcome.reason for outcome in outcomes]), "pid": np.full(len(outcomes), os.getpid()),
        }


def certify(dataset: Any, out: str | os.PathLike[str], *, workers: int = 1, **options: Any) -> Any:
    """The outcomes of a dataset's motions, as a dataset. A worker that dies costs the motion in its hands, which another one makes.

    dataset: rows with `path` and `name`, as of `paths`. out: the folder of the files. workers: number of processes. options: those of
    `Certify`. Nothing is computed before the result is read, such as by `take_all` or `materialize`.

        >>> import teleopd
        >>> teleopd.ray.certify(None, "out", workers=0)
        Traceback (most recent call last):
        ValueError: workers = 0: must be at least 1
    """
    if workers < 1:
        raise ValueError(f"workers = {workers}: must be at least 1")
    import ray.data

    return dataset.map_batches(
        Certify, fn_constructor_args=(str(Path(out).resolve()),), fn_constructor_kwargs=options, batch_size=1, num_cpus=1,
        compute=ray.data.ActorPoolStrategy(size=workers), max_restarts=-1, max_task_retries=-1,
    )
