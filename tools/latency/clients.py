"""Measures what programs beside an instance cost and get. Prints figures, and judges nothing.

    python3 tools/latency/clients.py readers [SECONDS OF A RUN] [RUNS OF EACH KIND]
    python3 tools/latency/clients.py policy [SECONDS]

`readers`: runs beside 8 viewers of the live view and 8 readers of the joints, and runs without them, in turns. One viewer
and one reader are stopped. Prints quantiles as medians of the runs. `policy`: sends chunks through the socket at random moments, and
prints how many of the robot's commands rest on the newest chunk, by the time since the first tick after it was sent. Needs
`cargo build --release -p teleopd -p replay -p record`.
"""
import json
import math
import os
import random
import re
import signal
import socket
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

PROGRAMS = Path(__file__).resolve().parents[2] / "target/release"
READERS = 8
#: what a run reports, by the process that measures it
FIGURES = [("control", "control_work"), ("driver", "target_to_command")]
QUANTILES = ["p50_us", "p99_us", "p99_9_us"]


def viewer(address):
    """Subscribes to every channel of the live view at ws://HOST:PORT/?token=TOKEN, and reads for ever."""
    host, query = address.removeprefix("ws://").split("/")
    door = socket.create_connection(host.split(":"))
    door.sendall(f"GET /{query} HTTP/1.1\r\nHost: {host}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
                 "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Version: 13\r\n"
                 "Sec-WebSocket-Protocol: foxglove.sdk.v1\r\n\r\n".encode())
    heard, ids = b"", []
    while len(ids) < 16:
        heard += door.recv(1 << 16)
        ids = re.findall(rb'"id":(\d+),"schema"', heard)
    all_of_them = [{"id": n, "channelId": int(one)} for n, one in enumerate(ids)]
    text = json.dumps({"op": "subscribe", "subscriptions": all_of_them}).encode()
    # A text frame, masked with zeros.
    door.sendall(b"\x81\xfe" + len(text).to_bytes(2, "big") + b"\0\0\0\0" + text)
    while door.recv(1 << 20):
        pass


def reader(path):
    """Reads the joints at the socket of policies for ever."""
    door = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    door.connect(path)
    door.send(b"teleopd policy 1")
    while door.recv(1 << 16):
        pass


def started(*command):
    return subprocess.Popen([str(part) for part in command], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)


def wait_for(child, word):
    for line in child.stdout:
        if word in line:
            return line
    sys.exit(f"{child.args[0]} ended")


class Instance:
    """The simulated robot under an operator's enable, in a folder of its own."""

    def __enter__(self):
        self.folder = tempfile.TemporaryDirectory()
        self.children = []
        wait_for(self.start("teleopd", "up", "--engage-without-realtime"), "READY")
        return self

    def start(self, program, *arguments):
        self.children.append(started(PROGRAMS / program, *arguments, "--run-dir", self.folder.name))
        return self.children[-1]

    def has_ended(self):
        """True if a program ended by itself, as the operator's does if the machine pauses. Prints its last line."""
        ended = [child for child in self.children if child.poll() is not None]
        for child in ended:
            print("repeated:", " ".join(child.args[:2]), child.stdout.read().strip().rsplit("\n", 1)[-1], flush=True)
        return bool(ended)

    def end(self):
        for child in self.children[:0:-1]:
            child.kill()
        for up in self.children[:1]:
            up.send_signal(signal.SIGINT)
            up.communicate()
        self.children = []

    def reports(self):
        """Ends the instance, and returns the reports of its processes."""
        self.end()
        return {name: json.loads((Path(self.folder.name) / f"{name}.json").read_text()) for name, _ in FIGURES}

    def __exit__(self, *_):
        self.end()
        self.folder.cleanup()


def run(seconds, watched):
    """Runs the robot for a time, and returns the reports of its processes, or None if something ended."""
    with Instance() as instance:
        if watched:
            record = instance.start("record", "--foxglove=0", "--engage-without-realtime")
            address = wait_for(record, "ws://").split()[-1]
            kinds = [("viewer", address), ("reader", os.path.join(instance.folder.name, "skeleton.sock"))]
            readers = [started("nice", sys.executable, __file__, *kind) for kind in kinds for _ in range(READERS)]
            instance.children += readers
            time.sleep(5.0)
            for stopped in readers[::READERS]:
                stopped.send_signal(signal.SIGSTOP)
        instance.start("replay", "builtin", "--loop")
        time.sleep(2.0)
        instance.start("teleopctl", "engage")
        time.sleep(seconds)
        return None if instance.has_ended() else instance.reports()


def policy(seconds=30.0):
    """Each chunk is named by the time of sending. The joints say on which one the executed command rests."""
    with Instance() as instance:
        door = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        door.connect(os.path.join(instance.folder.name, "skeleton.sock"))
        door.send(b"teleopd policy 1")
        start, newest, seen = None, None, []
        end, engages = time.monotonic() + float(seconds), time.monotonic() + 2.0
        while time.monotonic() < end:
            state = json.loads(door.recv(1 << 16))
            if not state.get("measured"):
                continue
            if time.monotonic() > engages and len(instance.children) == 1:
                instance.start("teleopctl", "engage")
            if newest and state["mode"] == "Engaged" and 0 < state["stamp_ns"] - newest < 9_000_000:
                tick = -(-((newest * 3 // 2_000_000 + 1) * 2_000_000) // 3)
                seen.append(((state["stamp_ns"] - tick) / 1e3, state["origin_ns"] == newest))
            start = start or state["measured"][3]
            # The next joints come 10 ms after these.
            time.sleep(max(0.0, (state["stamp_ns"] + 10_000_000 - time.monotonic_ns()) / 1e9 - random.uniform(0.0005, 0.004)))
            newest = time.monotonic_ns()
            rows = [[start + 0.05 * math.sin(newest / 1e9 + 0.05 * k)] for k in range(6)]
            door.send(json.dumps({"joints": [3], "rate_hz": 20, "positions": rows, "observed_ns": newest}).encode())
        print(f"{len(seen)} joints, of which the command rests on the chunk sent last, by the time since its tick:")
        for low in range(-600, 3000, 200):
            these = [in_force for after_us, in_force in seen if low <= after_us < low + 200]
            if len(these) >= 10:
                print(f"{low:5} to {low + 200} us: {100 * sum(these) / len(these):3.0f} % of {len(these)}")


def readers(seconds=20.0, rounds=6):
    runs = {False: [], True: []}
    for _ in range(int(rounds)):
        for watched, reports in runs.items():
            reports.append(next(filter(None, (run(float(seconds), watched) for _ in range(5)))))
    for name, metric in FIGURES:
        for quantile in QUANTILES:
            alone, watched = ([report[name]["telemetry"]["metrics"][metric][quantile] for report in reports]
                              for reports in runs.values())
            a, b = statistics.median(alone), statistics.median(watched)
            spread = f"{min(alone):.0f} to {max(alone):.0f}, {min(watched):.0f} to {max(watched):.0f}"
            print(f"{metric} {quantile}: alone {a:.1f}, watched {b:.1f} ({100 * (b / a - 1):+.1f} %; {spread})", flush=True)


if __name__ == "__main__":
    modes = {"readers": readers, "policy": policy, "viewer": viewer, "reader": reader}
    if len(sys.argv) < 2 or sys.argv[1] not in modes:
        sys.exit(__doc__)
    modes[sys.argv[1]](*sys.argv[2:])
