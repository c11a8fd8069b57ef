#!/usr/bin/env bash
# Packages:  foxglove-sdk 0.30.3 (PyPI), @foxglove/ws-protocol 0.8.0 and ws 8.23.0 (npm)
# Guess:     Foxglove's own client library connects to Foxglove's own server.
# Behaviour: the client asks for the subprotocol foxglove.websocket.v1, and the server only accepts foxglove.sdk.v1. It answers
#            400. The messages that the client reads are the same: with the server's name it lists the channels.
# Seen:      2026-11-30, Python 3.11, node 20. Output:
#            foxglove.websocket.v1: Unexpected server response: 400
#            foxglove.sdk.v1: /angle
# Takes:     20 s.
set -euo pipefail
work=$(mktemp -d)
trap 'kill "${server:-}" 2>/dev/null || true; rm -rf "$work"' EXIT
cd "$work"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check foxglove-sdk==0.30.3
npm install --silent --no-audit --no-fund --prefix "$work" @foxglove/ws-protocol@0.8.0 ws@8.23.0 >/dev/null

cat > serve.py <<'PY'
import time

import foxglove
from foxglove import Channel

server = foxglove.start_server(host="127.0.0.1", port=0)
channel = Channel("/angle", schema={"type": "object", "properties": {"angle": {"type": "number"}}})
print(server.port, flush=True)
while True:
    channel.log({"angle": 1.0})
    time.sleep(0.1)
PY
cat > watch.cjs <<'JS'
const { FoxgloveClient } = require("@foxglove/ws-protocol");
const WebSocket = require("ws");

const [address, given] = process.argv.slice(2);
const protocol = given || FoxgloveClient.SUPPORTED_SUBPROTOCOL;
const say = (text) => {
  console.log(`${protocol}: ${text}`);
  process.exit(0);
};
const client = new FoxgloveClient({ ws: new WebSocket(address, [protocol]) });
client.on("error", (error) => say(error.message));
client.on("advertise", (channels) => say(channels.map((channel) => channel.topic).join(" ")));
JS
venv/bin/python serve.py > port.txt 2>/dev/null &
server=$!
for _ in $(seq 100); do
  [ -s port.txt ] && break
  sleep 0.1
done
address=ws://127.0.0.1:$(cat port.txt)
{ node watch.cjs "$address"; node watch.cjs "$address" foxglove.sdk.v1; } > seen.txt
cat seen.txt
if ! diff -q seen.txt - >/dev/null <<'SEEN'
foxglove.websocket.v1: Unexpected server response: 400
foxglove.sdk.v1: /angle
SEEN
then
  echo "CHANGED: the client and the server agree in another way" >&2
  exit 1
fi
echo "as stated: the client's own subprotocol is refused, the newer name is accepted"
