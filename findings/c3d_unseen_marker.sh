#!/usr/bin/env bash
# Packages:  c3d 0.6.0 and ezc3d 1.7.2 (PyPI)
# Guess:     a marker that no camera saw has no position, whichever reader of C3D one takes.
# Behaviour: the file holds a residual of -1 beside three numbers that mean nothing. ezc3d makes NaN of them. c3d hands
#            them over, and they look like a measurement: here its writer left the marker where it was last seen. The
#            residual alone tells.
# Seen:      2026-11-28, Python 3.11. Output (the marker's x, unseen in frame 3):
#            c3d: [1.0, 2.0, 2.0, 4.0], residual [0.0, 0.0, -1.0, 0.0]
#            ezc3d: [1.0, 2.0, nan, 4.0], residual [0.0, 0.0, -1.0, 0.0]
# Takes:     30 s.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check c3d==0.6.0 ezc3d==1.7.2

cat > read.py <<'PY'
import c3d, ezc3d
import numpy as np

writer = c3d.Writer(point_rate=100, analog_rate=0)
writer.set_point_labels(["wrist"])
for frame in range(1, 5):
    # x, y, z, residual and cameras. The wrist is hidden in frame 3.
    wrist = [0, 0, 0, -1, -1] if frame == 3 else [frame, 20, 30, 0, 0]
    writer.add_frames((np.array([wrist], float), np.zeros((0, 0))))
with open("motion.c3d", "wb") as file:
    writer.write(file)

with open("motion.c3d", "rb") as file:
    points = [points[0] for _, points, _ in c3d.Reader(file).read_frames()]
print(f"c3d: {[float(p[0]) for p in points]}, residual {[float(p[3]) for p in points]}")
data = ezc3d.c3d("motion.c3d")["data"]
print(f"ezc3d: {data['points'][0, 0].tolist()}, residual {data['meta_points']['residuals'][0, 0].tolist()}")
PY
venv/bin/python -W ignore read.py > seen.txt
cat seen.txt
if ! diff -q seen.txt - >/dev/null <<'SEEN'
c3d: [1.0, 2.0, 2.0, 4.0], residual [0.0, 0.0, -1.0, 0.0]
ezc3d: [1.0, 2.0, nan, 4.0], residual [0.0, 0.0, -1.0, 0.0]
SEEN
then
  echo "CHANGED: the readers give an unseen marker in another way" >&2
  exit 1
fi
echo "as stated: one reader gives NaN, the other a position"
