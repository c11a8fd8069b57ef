#!/usr/bin/env bash
# Packages:  pin 4.1.0 (Pinocchio), mujoco 4.0.0, yourdfpy 0.0.60, urchin 0.0.30 (PyPI)
# Guess:     the readers of URDF number a robot's joints alike, at least a parent before its child.
# Behaviour: four readers give four orders. Pinocchio takes siblings by the names of their joints, MuJoCo by their place
#            in the file, each with its whole branch. urchin goes level by level. yourdfpy keeps the file's order, even
#            if a child comes first. A vector of positions without names fits one of them only.
# Seen:      2026-11-28, Python 3.11. Output:
#            pinocchio: left_shoulder right_shoulder right_elbow
#            mujoco: right_shoulder right_elbow left_shoulder
#            yourdfpy: right_elbow right_shoulder left_shoulder
#            urchin: right_shoulder left_shoulder right_elbow
# Takes:     90 s.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check pin==4.1.0 mujoco==4.0.0 yourdfpy==0.0.60 urchin==0.0.30

cat > read.py <<'PY'
import mujoco, pinocchio, urchin, yourdfpy

def link(name):
    mass = '<mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
    return f'<link name="{name}"><inertial>{mass}</inertial></link>'

def joint(name, parent, child):
    limit = '<limit lower="-1" upper="1" effort="1" velocity="1"/>'
    ends = f'<parent link="{parent}"/><child link="{child}"/><axis xyz="0 0 1"/>'
    return f'<joint name="{name}" type="revolute">{ends}{limit}</joint>'

links = [link(name) for name in ("trunk", "right_upper", "right_fore", "left_upper")]
joints = [
    joint("right_elbow", "right_upper", "right_fore"),
    joint("right_shoulder", "trunk", "right_upper"),
    joint("left_shoulder", "trunk", "left_upper"),
]
with open("robot.urdf", "w") as file:
    file.write(f'<robot name="two_arms">{"".join(links + joints)}</robot>')

model = mujoco.MjModel.from_xml_path("robot.urdf")
print("pinocchio:", *list(pinocchio.buildModelFromUrdf("robot.urdf").names)[1:])
print("mujoco:", *[model.joint(number).name for number in range(model.njnt)])
print("yourdfpy:", *yourdfpy.URDF.load("robot.urdf").actuated_joint_names)
print("urchin:", *urchin.URDF.load("robot.urdf").actuated_joint_names)
PY
venv/bin/python -W ignore read.py > seen.txt
cat seen.txt
if ! diff -q seen.txt - >/dev/null <<'SEEN'
pinocchio: left_shoulder right_shoulder right_elbow
mujoco: right_shoulder right_elbow left_shoulder
yourdfpy: right_elbow right_shoulder left_shoulder
urchin: right_shoulder left_shoulder right_elbow
SEEN
then
  echo "CHANGED: the readers order the joints in another way" >&2
  exit 1
fi
echo "as stated: four readers of one URDF give four orders of its joints"
