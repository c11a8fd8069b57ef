"""A session with a running daemon."""

from __future__ import annotations

from numpy.typing import ArrayLike

from . import client


class Session:
    """Publishes skeletons to a running `teleopd up`, and reads what the robot does. It needs the package iceoryx2.

    run_dir: the folder of the instance. layout: a number of `teleopd.client`, SMPL-22 by default.

        with teleopd.Session("/tmp/teleopd") as session:
            session.publish(positions)          # (22, 3), m, 30 to 240 times a second
            print(session.mode, session.sentence)
    """

    def __init__(self, run_dir: str = client.DEFAULT_RUN_DIR, layout: int = client.LAYOUT_SMPL22) -> None:
        self._publisher = client.SkeletonPublisher(run_dir, layout)
        self._reader = client.FeedbackReader(run_dir)
        self._feedback: client.Feedback | None = None

    def publish(self, positions: ArrayLike, rotations: ArrayLike | None = None, **others: object) -> int:
        """Publishes a frame and answers its number. The others are those of `teleopd.client.SkeletonPublisher.publish`."""
        return self._publisher.publish(positions, rotations, **others)

    @property
    def feedback(self) -> client.Feedback | None:
        """The newest feedback, 20 a second. None before the first."""
        self._feedback = self._reader.latest() or self._feedback
        return self._feedback

    @property
    def mode(self) -> str | None:
        """The robot's mode, such as "Engaged". None before the first feedback."""
        feedback = self.feedback
        return None if feedback is None else client.MODES[feedback.mode]

    @property
    def sentence(self) -> str | None:
        """Why the robot does what it does. None before the first feedback."""
        feedback = self.feedback
        return None if feedback is None else client.sentence(feedback)

    def close(self) -> None:
        """Leaves. The robot then stops, as at any silence."""
        self._publisher.close()
        self._reader.close()

    def __enter__(self) -> Session:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
