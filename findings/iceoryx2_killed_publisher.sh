#!/usr/bin/env bash
# Package:   iceoryx2 0.10.0 (PyPI)
# Guess:     a publisher whose process was killed is no longer counted, and its place is free.
# Behaviour: it is counted, and keeps its place, until some process creates a node in the same domain. Its subscribers
#            see silence only. So the count of publishers says nothing about who is alive.
# Seen:      2026-11-28, Linux 6.18, Python 3.11. Output:
#            publishers before and 1 s after kill -9: 1, 1
#            another publisher: ExceedsMaxSupportedPublishers
#            publishers after another node was created: 0
#            another publisher: created
# Takes:     20 s.
set -euo pipefail
work=$(mktemp -d)
name=finding_${work##*.}_
trap 'rm -rf "$work" /dev/shm/"$name"*' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check iceoryx2==0.10.0

cat > "$work/finding.py" <<'PY'
import ctypes, subprocess, sys, time
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

def node():
    return iox2.NodeBuilder.new().config(config).create(iox2.ServiceType.Ipc)

first = node()
service = first.service_builder(iox2.ServiceName.new("killed")).publish_subscribe(Message)
service = service.max_publishers(1).open_or_create()
if sys.argv[3] == "publisher":
    publisher = service.publisher_builder().create()
    publisher.send_copy(Message(1))
    print("ready", flush=True)
    time.sleep(600)

def count():
    return service.dynamic_config.number_of_publishers

def another():
    try:
        service.publisher_builder().create()
        return "created"
    except iox2.PublisherCreateError as error:
        return str(error)

command = [sys.executable, __file__, *sys.argv[1:3], "publisher"]
with subprocess.Popen(command, stdout=subprocess.PIPE) as publisher:
    publisher.stdout.readline()
    before = count()
    publisher.kill()
time.sleep(1)
seen = [before, count(), another()]
print(f"publishers before and 1 s after kill -9: {seen[0]}, {seen[1]}")
print(f"another publisher: {seen[2]}")
second = node()
seen += [count(), another()]
print(f"publishers after another node was created: {seen[3]}")
print(f"another publisher: {seen[4]}")
if seen != [1, 1, "ExceedsMaxSupportedPublishers", 0, "created"]:
    sys.exit("CHANGED: a killed publisher is counted in another way")
print("as stated: a killed publisher is counted and keeps its place until a node is created")
PY
"$work/venv/bin/python" "$work/finding.py" "$work/bus" "$name" subscriber
