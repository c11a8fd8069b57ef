import json, struct, sys, threading, zenoh
config = zenoh.Config.from_json5(sys.argv[1])
got = threading.Event()
seen = []
def take(sample):
    seen.append(bytes(sample.payload))
    got.set()
with zenoh.open(config) as session:
    session.declare_subscriber("teleop/tiago/status", take)
    assert got.wait(15), "no status"
version, length = struct.unpack_from("<II", seen[0])
assert len(seen[0]) == 8 + length, (length, len(seen[0]))
print(version, length)
