#!/usr/bin/env bash
# Package:   mujoco 4.0.0 (PyPI)
# Guess:     a flat plate has inertias A + B = C, and MuJoCo's check A + B >= C admits them.
# Behaviour: the check has no tolerance. 0.1 + 0.2 and 0.3 are accepted, because the sum of the doubles is rounded up.
#            0.1 + 0.7 and 0.8 are refused, because it is rounded down by 1.1e-16. The advised option changes the model.
# Seen:      2026-11-28, Python 3.11. Output:
#            0.1 0.2 0.3: accepted
#            0.1 0.7 0.8: inertia must satisfy A + B >= C; use 'balanceinertia' to fix
#            0.01 0.06 0.07: inertia must satisfy A + B >= C; use 'balanceinertia' to fix
# Takes:     40 s.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check mujoco==4.0.0

"$work/venv/bin/python" - <<'PY'
import sys
import mujoco

def answer(a, b, c):
    inertial = f'<inertial pos="0 0 0" mass="1" diaginertia="{a} {b} {c}"/>'
    try:
        mujoco.MjModel.from_xml_string(f"<mujoco><worldbody><body><freejoint/>{inertial}</body></worldbody></mujoco>")
        return "accepted"
    except ValueError as error:
        return str(error).splitlines()[0].removeprefix("Error: ")

refused = "inertia must satisfy A + B >= C; use 'balanceinertia' to fix"
plates = {(0.1, 0.2, 0.3): "accepted", (0.1, 0.7, 0.8): refused, (0.01, 0.06, 0.07): refused}
seen = {plate: answer(*plate) for plate in plates}
for plate, text in seen.items():
    print(*plate, end=f": {text}\n")
if seen != plates:
    sys.exit("CHANGED: other flat inertias are refused")
print("as stated: rounding decides whether a flat plate's inertia is accepted")
PY
