#!/usr/bin/env bash
# Packages:  mcap 1.6.0 (PyPI), @mcap/core 2.2.2 (npm)
# Guess:     readers of MCAP agree on a valid file. One that needs an index refuses a file without it.
# Behaviour: chunks and indices are optional. Python's reader finds all messages without them. The indexed reader for
#            JavaScript finds none, without an error, while the stream reader of the same package finds all.
# Seen:      2026-11-28, Python 3.11, node 20. Output:
#            indexed.mcap: Python 4, JavaScript indexed 4, JavaScript stream 4
#            no_index.mcap: Python 4, JavaScript indexed 0, JavaScript stream 4
#            no_chunks.mcap: Python 4, JavaScript indexed 0, JavaScript stream 4
# Takes:     30 s.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check mcap==1.6.0
npm install --silent --no-audit --no-fund --prefix "$work" @mcap/core@2.2.2 >/dev/null

cat > files.py <<'PY'
import sys
from mcap.reader import make_reader
from mcap.writer import CompressionType, IndexType, Writer

FILES = {
    "indexed": {},
    "no_index": {"index_types": IndexType.NONE},
    "no_chunks": {"use_chunking": False},
}
for name, options in FILES.items():
    with open(f"{name}.mcap", "wb") as file:
        writer = Writer(file, compression=CompressionType.NONE, **options)
        writer.start()
        schema = writer.register_schema("number", "jsonschema", b"{}")
        channel = writer.register_channel("/number", "json", schema)
        for number in range(4):
            writer.add_message(channel, 10 * number, str(number).encode(), 10 * number, number)
        writer.finish()
    with open(f"{name}.mcap", "rb") as file:
        print(name, len(list(make_reader(file).iter_messages())))
PY
cat > read.mjs <<'JS'
import { readFileSync } from "node:fs";
import { McapIndexedReader, McapStreamReader } from "@mcap/core";

for (const name of process.argv.slice(2)) {
  const bytes = new Uint8Array(readFileSync(`${name}.mcap`));
  const readable = {
    size: async () => BigInt(bytes.length),
    read: async (from, length) => bytes.slice(Number(from), Number(from + length)),
  };
  let indexed = 0;
  for await (const _ of (await McapIndexedReader.Initialize({ readable })).readMessages()) indexed += 1;
  const reader = new McapStreamReader();
  reader.append(bytes);
  let stream = 0;
  for (let record = reader.nextRecord(); record; record = reader.nextRecord()) stream += record.type === "Message";
  console.log(indexed, stream);
}
JS
venv/bin/python files.py > python.txt
node read.mjs indexed no_index no_chunks > javascript.txt
paste -d ' ' python.txt javascript.txt > seen.txt
while read -r name python indexed stream; do
  echo "$name.mcap: Python $python, JavaScript indexed $indexed, JavaScript stream $stream"
done < seen.txt
if ! diff -q seen.txt - >/dev/null <<'SEEN'
indexed 4 4 4
no_index 4 0 4
no_chunks 4 0 4
SEEN
then
  echo "CHANGED: the readers see other numbers of messages" >&2
  exit 1
fi
echo "as stated: without an index, one reader finds nothing and reports no error"
