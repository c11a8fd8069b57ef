#!/usr/bin/env bash
# Package:   iceoryx2 0.10.0 (PyPI), on Linux
# Guess:     a listener that waits for at most 0.667 ms returns after some 0.7 ms, as a sleep of this length does.
# Behaviour: the wait is a socket's timeout, which Linux counts in whole scheduler ticks. Here it takes two or more, 8 ms
#            on a kernel of 250 Hz. A loop at 1500 Hz cannot use it as its timer.
# Seen:      2026-11-28, Linux 6.18 at 250 Hz, Python 3.11, median of 100. Output:
#            a sleep of 0.667 ms took 0.75 ms
#            a wait of 0.667 ms took 8.00 ms (12.01 at a load of 15)
# Takes:     20 s. Other kernels have ticks of 1 to 10 ms.
set -euo pipefail
work=$(mktemp -d)
name=finding_${work##*.}_
trap 'rm -rf "$work" /dev/shm/"$name"*' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check iceoryx2==0.10.0

"$work/venv/bin/python" - "$work/bus" "$name" <<'PY'
import statistics, sys, time
import iceoryx2 as iox2

iox2.set_log_level(iox2.LogLevel.Fatal)
config = iox2.config.default()
config.global_cfg.root_path = iox2.Path.new(sys.argv[1])
config.global_cfg.prefix = iox2.FileName.new(sys.argv[2])
node = iox2.NodeBuilder.new().config(config).create(iox2.ServiceType.Ipc)
event = node.service_builder(iox2.ServiceName.new("wait")).event().create()
listener = event.listener_builder().create()

def median_ms(wait):
    times = []
    for _ in range(100):
        begin = time.monotonic()
        wait()
        times.append(1e3 * (time.monotonic() - begin))
    return statistics.median(times)

slept = median_ms(lambda: time.sleep(667e-6))
waited = median_ms(lambda: listener.timed_wait(iox2.Duration.from_micros(667)))
print(f"a sleep of 0.667 ms took {slept:.2f} ms")
print(f"a wait of 0.667 ms took {waited:.2f} ms")
# The shortest tick is 1 ms, so that even one is longer than this.
if waited < max(0.95, slept + 0.15):
    sys.exit("CHANGED: a timed wait is as exact as a sleep")
print("as stated: a timed wait takes whole scheduler ticks")
PY
