"""A running teleopd for the scripts of this folder, and the programs beside it."""

import signal
import subprocess
import time

from teleopd import client

#: Exit code of a daemon that Ctrl-C ended.
INTERRUPTED = 130


class Rig:
    """The simulated robot in a folder of its own. What was started ends with it."""

    def __init__(self, folder, programs, *options):
        self.run_dir, self._programs, self._started = folder / "run", programs, []
        self.up = self.start("teleopd", "up", "--engage-without-realtime", *options)
        try:
            self.joints(lambda newest: True)
        except BaseException:
            self.__exit__()
            raise

    def start(self, program, *words):
        """Starts a program of teleopd in this instance."""
        return self.keep(subprocess.Popen(
            [str(self._programs / program), *map(str, words), "--run-dir", str(self.run_dir)], stdout=subprocess.DEVNULL))

    def keep(self, process):
        """Ends this process, too."""
        self._started.append(process)
        return process

    def joints(self, until, within_s=60.0):
        """The first joints for which `until` holds."""
        give_up = time.monotonic() + within_s
        while time.monotonic() < give_up:
            try:
                with client.JointsReader(self.run_dir) as reader:
                    while time.monotonic() < give_up:
                        newest = reader.latest()
                        if newest is not None and until(newest):
                            return newest
                        time.sleep(0.01)
            except (client.TeleopdError, OSError):
                time.sleep(0.5)
        raise AssertionError("the robot does not do what is waited for")

    def engaged(self, sources):
        """Engages as soon as `sources` can lead. Returns the operator's process."""
        give_up = time.monotonic() + 120.0
        while time.monotonic() < give_up:
            operator = self.start("teleopctl", "engage")
            while operator.poll() is None and time.monotonic() < give_up:
                if self.joints(lambda newest: True).sources == sources:
                    return operator
                time.sleep(0.2)
            time.sleep(1.0)
        raise AssertionError("the robot is not engaged")

    def __enter__(self):
        return self

    def __exit__(self, *_):
        end(*[process for process in self._started if process.poll() is None])


def end(*processes):
    """Ends processes as Ctrl-C does. Returns their exit codes."""
    for process in processes:
        process.send_signal(signal.SIGINT)
    return [process.wait(30) for process in processes]
