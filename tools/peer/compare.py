"""Measures speed, delay and memory beside their peers, in turns, and prints one table.

    python3 tools/peer/compare.py [--motions FOLDER] [--rounds 7] [--sew COMMAND] [--before REPLAY]

It builds what it runs, and installs placo from PyPI into `target/results/placo`. COMMAND runs a build of SEW-Mimic's closed form, and
prints the microseconds that one frame of both arms takes. REPLAY is `replay` of an older build, which computes the same motions. A peer
that nobody names has no row. Every figure is a median over the rounds. Other load changes the times more than the ratios.
"""

import argparse
import json
import os
import re
import shlex
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
RELEASE = ROOT / "target/release"
PLACO = ROOT / "target/results/placo"


def run(*command: str | Path) -> str:
    return subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True, cwd=ROOT).stdout


def row(what: str, ours: str, peer: str = "", ratio: str = "") -> None:
    print(f"| {what} | {ours} | {peer} | {ratio} |", flush=True)


def control_ticks(rounds: int) -> None:
    """Whole-body control and gate beside placo's solver, and the slowest of a thousand ticks beside a busy program."""
    if not PLACO.exists():
        run(sys.executable, "-m", "venv", PLACO)
        run(PLACO / "bin/pip", "install", "--quiet", "-r", "tools/torture/requirements.txt")
    printed = run(PLACO / "bin/python", "tools/torture/bench_placo.py", "--rounds", str(rounds))
    lines = re.findall(r"^(.*\S) +p50 +(\S+) .* placo's (\S+)$", printed, re.MULTILINE)
    (placo, placo_us, _), *ours = lines
    for name, us, ratio in ours:
        row(f"control tick, {name.removeprefix('ours: ')}", f"{us} us", f"{placo_us} us ({placo})", f"{float(ratio):.2f}")
    busy = subprocess.Popen([sys.executable, "-c", "while True: pass"])
    slowest = statistics.median(smooth_p99_9_us() for _ in range(rounds))
    busy.kill()
    row("control tick, smooth, p99.9 beside a busy program", f"{slowest:.1f} us")


def smooth_p99_9_us() -> float:
    return json.loads(run(RELEASE / "examples/control_tick", "--ticks", "20000", "--only", "smooth"))["smooth_us"]["p99_9"]


def retarget_tick(rounds: int, sew: str | None) -> None:
    """A tick with a new skeleton, both arms."""
    ours, peer = [], []
    for _ in range(rounds):
        bench = ["cargo", "bench", "--locked", "-p", "world", "--bench", "tick", "--", "--noplot", "^retarget tick$"]
        ours.append(float(re.search(r"time: +\[\S+ \S+ (\S+) µs", run(*bench)).group(1)))
        if sew:
            peer.append(float(run(*shlex.split(sew)).split()[-1]))
    ratio = statistics.median(a / b for a, b in zip(ours, peer)) if peer else None
    known = (f"{statistics.median(peer):.1f} us (SEW-Mimic)", f"{ratio:.2f}") if peer else ()
    row("retarget tick, new skeleton, both arms", f"{statistics.median(ours):.1f} us", *known)


def certified(replay: Path, motions: Path, jobs: int) -> tuple[float, float]:
    """Rows a second and peak memory in MB of a folder that is certified."""
    with tempfile.TemporaryDirectory() as out:
        command = [replay, "batch", "--certified", "--jobs", str(jobs), "--input", motions, "--out", out]
        begun = time.monotonic()
        child = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        _, status, used = os.wait4(child.pid, 0)
        taken_s = time.monotonic() - begun
        if status != 0:
            raise SystemExit(f"{replay} batch ended with {os.waitstatus_to_exitcode(status)}")
        rows = sum(path.read_text().count("\n") - 1 for path in Path(out).rglob("*.csv"))
    return rows / taken_s, used.ru_maxrss / 1024


def datasets(rounds: int, motions: Path, before: Path | None) -> None:
    one, two, old = [], [], []
    for _ in range(rounds):
        one.append(certified(RELEASE / "replay", motions, 1))
        two.append(certified(RELEASE / "replay", motions, 2))
        if before:
            old.append(certified(before, motions, 1))

    def rate(times: list[tuple[float, float]]) -> float:
        return statistics.median(rows for rows, _ in times)

    def ratio(times: list[tuple[float, float]], peer: list[tuple[float, float]]) -> str:
        return f"{statistics.median(a / b for (a, _), (b, _) in zip(times, peer)):.2f}"

    known = (f"{rate(old):.0f} rows/s (before)", ratio(one, old)) if old else ()
    row("certified commands at 1500 Hz, one worker", f"{rate(one):.0f} rows/s", *known)
    row("the same, two workers beside one", f"{rate(two):.0f} rows/s", f"{rate(one):.0f} rows/s", ratio(two, one))
    row("memory of one worker", f"{max(memory for _, memory in one):.0f} MB")


def following(motions: Path) -> None:
    for delay_ms in (120, 80, 60):
        with tempfile.TemporaryDirectory(dir=ROOT / "config", prefix=".compare") as folder:
            # Paths in the settings are relative to their file.
            text = (ROOT / "config/teleop.toml").read_text().replace('"../', '"../../').replace('"robots/', '"../robots/')
            settings, figures = Path(folder, "teleop.toml"), Path(folder, "figures.json")
            settings.write_text(re.sub(r"(?m)^following_delay_ms = .*", f"following_delay_ms = {delay_ms}.0", text))
            run(RELEASE / "eval", "--following", motions, "--config", settings, "--delay-ms", str(delay_ms), "--json", figures)
            mean = json.loads(figures.read_text())["mean"]
        row(f"robot behind the person by {delay_ms} ms, `following_delay_ms` {delay_ms}", f"{mean['at_delay_deg']:.1f} degrees")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--motions", type=Path, default=ROOT / "tools/replay/motions")
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--sew", metavar="COMMAND")
    parser.add_argument("--before", type=Path, metavar="REPLAY")
    options = parser.parse_args()
    motions = options.motions.resolve()
    run("cargo", "build", "--release", "--locked", "--quiet", "-p", "replay", "-p", "eval")
    run("cargo", "build", "--release", "--locked", "--quiet", "-p", "torture", "--example", "control_tick")
    row("what", "ours", "peer", "ours over the peer's")
    row("---", "---", "---", "---")
    control_ticks(options.rounds)
    retarget_tick(options.rounds, options.sew)
    datasets(options.rounds, motions, options.before)
    following(motions)


main()
