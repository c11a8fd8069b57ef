#!/usr/bin/env bash
# Packages:  pin 4.1.0 (Pinocchio), mujoco 4.0.0, yourdfpy 0.0.60 (PyPI)
# Guess:     a revolute joint whose <limit> has no lower and upper means the same to every reader: 0 to 0, as the
#            description of URDF says (both are optional and 0 if left out).
# Behaviour: for Pinocchio the joint cannot move. For MuJoCo it turns without end, and no warning says so. With 0 and 0
#            written out it does, too, with a warning. yourdfpy says that nothing is known.
# Seen:      2026-11-28, Python 3.11. Output:
#            left out: pinocchio [0.0, 0.0], mujoco unlimited, yourdfpy [None, None]
#            written as 0: pinocchio [0.0, 0.0], mujoco unlimited, yourdfpy [0.0, 0.0]
#            written as -1 and 1: pinocchio [-1.0, 1.0], mujoco [-1.0, 1.0], yourdfpy [-1.0, 1.0]
# Takes:     90 s.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check pin==4.1.0 mujoco==4.0.0 yourdfpy==0.0.60

cat > read.py <<'PY'
import mujoco, pinocchio, yourdfpy

RANGES = {"left out": "", "written as 0": 'lower="0" upper="0"', "written as -1 and 1": 'lower="-1" upper="1"'}
MASS = '<mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
for title, span in RANGES.items():
    limit = f'<limit {span} effort="1" velocity="1"/>'
    ends = '<parent link="trunk"/><child link="arm"/><axis xyz="0 0 1"/>'
    joint = f'<joint name="shoulder" type="revolute">{ends}{limit}</joint>'
    links = f'<link name="trunk"/><link name="arm"><inertial>{MASS}</inertial></link>'
    with open("robot.urdf", "w") as file:
        file.write(f'<robot name="arm">{links}{joint}</robot>')
    first = pinocchio.buildModelFromUrdf("robot.urdf")
    pin = [float(first.lowerPositionLimit[0]), float(first.upperPositionLimit[0])]
    second = mujoco.MjModel.from_xml_path("robot.urdf")
    muj = second.jnt_range[0].tolist() if second.jnt_limited[0] else "unlimited"
    third = yourdfpy.URDF.load("robot.urdf").actuated_joints[0].limit
    print(f"{title}: pinocchio {pin}, mujoco {muj}, yourdfpy {[third.lower, third.upper]}")
PY
venv/bin/python -W ignore read.py > seen.txt   # MuJoCo's warning goes to the error stream.
cat seen.txt
if ! diff -q seen.txt - >/dev/null <<'SEEN'
left out: pinocchio [0.0, 0.0], mujoco unlimited, yourdfpy [None, None]
written as 0: pinocchio [0.0, 0.0], mujoco unlimited, yourdfpy [0.0, 0.0]
written as -1 and 1: pinocchio [-1.0, 1.0], mujoco [-1.0, 1.0], yourdfpy [-1.0, 1.0]
SEEN
then
  echo "CHANGED: the readers take the range in another way" >&2
  exit 1
fi
echo "as stated: one reader locks the joint, one lets it turn without end"
