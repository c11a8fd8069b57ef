#!/usr/bin/env bash
# Package:   iceoryx2 0.10.0 (PyPI)
# Guess:     a service with history keeps its last messages for every later subscriber, because they lie in shared memory.
# Behaviour: the living publisher hands the history over, and only when it sends again or updates its connections. A
#            subscriber that came before the publisher's end, but after its last call, gets nothing. One that was
#            connected keeps what it has not read yet.
# Seen:      2026-11-28, Linux 6.18, Python 3.11. Output:
#            late subscriber, publisher idle: []
#            the same, publisher updated its connections: [1, 2]
#            connected subscriber, publisher gone: [1, 2, 3]
#            late subscriber, publisher gone: []
#            new subscriber, publisher gone: []
# Takes:     20 s.
set -euo pipefail
work=$(mktemp -d)
name=finding_${work##*.}_
trap 'rm -rf "$work" /dev/shm/"$name"*' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check iceoryx2==0.10.0

"$work/venv/bin/python" - "$work/bus" "$name" <<'PY'
import ctypes, sys
import iceoryx2 as iox2

iox2.set_log_level(iox2.LogLevel.Fatal)

class Message(ctypes.Structure):
    _fields_ = [("number", ctypes.c_uint64)]

    @staticmethod
    def type_name() -> str:
        return "Message"

config = iox2.config.default()
config.global_cfg.root_path = iox2.Path.new(sys.argv[1])
config.global_cfg.prefix = iox2.FileName.new(sys.argv[2])
node = iox2.NodeBuilder.new().config(config).create(iox2.ServiceType.Ipc)
service = node.service_builder(iox2.ServiceName.new("history")).publish_subscribe(Message)
service = service.history_size(2).subscriber_max_buffer_size(4).create()

def subscriber():
    return service.subscriber_builder().buffer_size(4).create()

def read(port):
    numbers = []
    while (sample := port.receive()) is not None:
        numbers.append(sample.payload().contents.number)
        sample.delete()
    return numbers

seen = []

def look(what, port):
    seen.append(read(port))
    print(f"{what}: {seen[-1]}")

publisher = service.publisher_builder().create()
for number in range(3):
    publisher.send_copy(Message(number))
connected = subscriber()
look("late subscriber, publisher idle", connected)
publisher.update_connections()
look("the same, publisher updated its connections", connected)
# It reads none of these before the publisher's end.
connected = subscriber()
publisher.send_copy(Message(3))
late = subscriber()
publisher.delete()
look("connected subscriber, publisher gone", connected)
look("late subscriber, publisher gone", late)
look("new subscriber, publisher gone", subscriber())
if seen != [[], [1, 2], [1, 2, 3], [], []]:
    sys.exit("CHANGED: the history reaches subscribers in another way")
print("as stated: only a living publisher hands over its history, at its next call")
PY
