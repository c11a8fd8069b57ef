#!/usr/bin/env bash
# Package:   eclipse-zenoh 1.10.2 (PyPI)
# Guess:     a subscriber that nobody reads loses its own messages. Others of the session go on.
# Behaviour: a subscriber with a channel holds 256 messages. The next one blocks the session's thread that receives, so
#            no other subscriber of the session gets anything, on any key, until somebody reads the channel.
# Seen:      2026-11-28, Python 3.11. Output:
#            1000 messages for each of two keys, the channel unread: the callback got 256
#            after 256 more were read from the channel: 513
#            after all were read: 1000
# Takes:     30 s. The middle figure varies by a few.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check eclipse-zenoh==1.10.2

"$work/venv/bin/python" - <<'PY'
import socket, sys, threading, time
import zenoh

with socket.socket() as probe:
    probe.bind(("127.0.0.1", 0))
    address = f'["tcp/127.0.0.1:{probe.getsockname()[1]}"]'

def session(listen, connect):
    config = zenoh.Config()
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("listen/endpoints", listen)
    config.insert_json5("connect/endpoints", connect)
    return zenoh.open(config)

def settled(got):
    """Waits until no message has come for a second."""
    count = -1
    while count != len(got):
        count = len(got)
        time.sleep(1)
    return count

receiver, sender = session(address, "[]"), session("[]", address)
got = []
unread = receiver.declare_subscriber("robot/unread")
callback = receiver.declare_subscriber("robot/read", got.append)
time.sleep(1)

def send():
    for _ in range(1000):
        sender.put("robot/unread", b"x", congestion_control=zenoh.CongestionControl.BLOCK)
        sender.put("robot/read", b"x", congestion_control=zenoh.CongestionControl.BLOCK)

threading.Thread(target=send, daemon=True).start()
first = settled(got)
print(f"1000 messages for each of two keys, the channel unread: the callback got {first}")
for _ in range(256):
    unread.recv()
second = settled(got)
print(f"after 256 more were read from the channel: {second}")
# The 257th, which was stuck, has come, too.
for _ in range(1000 - 256):
    unread.recv()
third = settled(got)
print(f"after all were read: {third}")
sender.close()
receiver.close()
if not (250 <= first <= 260 and first + 200 <= second <= first + 300 and third == 1000):
    sys.exit("CHANGED: an unread subscriber holds up others in another way")
print("as stated: one unread subscriber stops all others of its session")
PY
