"""Reads a BVH file, and says where the joints of the person are. Metres, y up.

Only positions are used: a file's rotations are relative to a rest pose, and many files have none.
"""

from pathlib import Path

import numpy as np

# The names that a joint has in files of the CMU motions, and in ours.
NAMES = {
    "hip": ("{Side}UpLeg", "{s}Thigh", "CC_Base_{S}_Thigh"),
    "knee": ("{Side}Leg", "{s}Shin", "CC_Base_{S}_Calf"),
    "ankle": ("{Side}Foot", "{s}Foot", "CC_Base_{S}_Foot"),
    "collar": ("{Side}Shoulder", "{s}Collar", "CC_Base_{S}_Clavicle"),
    "shoulder": ("{Side}Arm", "{s}Shldr", "CC_Base_{S}_Upperarm"),
    "elbow": ("{Side}ForeArm", "{s}ForeArm", "CC_Base_{S}_Forearm"),
    "wrist": ("{Side}Hand", "{s}Hand", "CC_Base_{S}_Hand"),
}
# The joint at which an ankle and a wrist point. In other files it is their first child.
ENDS = {"ankle": "CC_Base_{S}_ToeBase", "wrist": "CC_Base_{S}_Mid1"}
HEAD = ("Head", "head", "CC_Base_Head")
NECK = ("Neck", "neck", "CC_Base_NeckTwist01")
SIDES = ("left", "right")
CENTIMETRE = 0.01


def turns(axes, degrees):
    """Rotations (F,3,3) about the axes in turn, from degrees (F,n)."""
    whole = np.broadcast_to(np.eye(3), (len(degrees), 3, 3))
    for axis, angle in zip(axes, np.radians(degrees).T):
        i = "XYZ".index(axis)
        j, k = (i + 1) % 3, (i + 2) % 3
        one = np.zeros((len(angle), 3, 3))
        one[:, i, i] = 1
        one[:, j, j] = one[:, k, k] = np.cos(angle)
        one[:, k, j] = np.sin(angle)
        one[:, j, k] = -np.sin(angle)
        whole = whole @ one
    return whole


class Clip:
    """A motion: `period_s`, and `positions` of the joints at given times."""

    def __init__(self, path):
        head, motion = Path(path).read_text().split("MOTION", 1)
        self.joints = []  # name, parent, offset, channels
        above = []
        for line in head.splitlines():
            words = line.split()
            if not words:
                continue
            if words[0] in ("ROOT", "JOINT", "End"):
                self.joints.append([words[1], above[-1] if above else None, None, []])
            elif words[0] == "{":
                above.append(len(self.joints) - 1)
            elif words[0] == "}":
                above.pop()
            elif words[0] == "OFFSET":
                self.joints[above[-1]][2] = np.array(words[1:4], float) * CENTIMETRE
            elif words[0] == "CHANNELS":
                self.joints[above[-1]][3] = words[2:]
        lines = motion.strip().splitlines()
        self.period_s = float(lines[1].split()[-1])
        self.rows = np.array([line.split() for line in lines[2:] if line.strip()], float)
        self.name = Path(path).stem

    @property
    def length_s(self):
        return (len(self.rows) - 1) * self.period_s

    def frames(self, start_s, length_s, rate_hz):
        """Rows at `rate_hz`. The first row of many files is a T-pose, and is left out."""
        rows = 1 + np.round((start_s + np.arange(int(length_s * rate_hz)) / rate_hz) / self.period_s).astype(int)
        return self.rows[rows[rows < len(self.rows)]]

    def everywhere(self, rows):
        """Positions (F,3) of each joint, by its number."""
        places, frames, at = [], [], 0
        for name, parent, offset, channels in self.joints:
            own = rows[:, at : at + len(channels)]
            at += len(channels)
            moved = [n for n, channel in enumerate(channels) if channel.endswith("position")]
            turned = [n for n, channel in enumerate(channels) if channel.endswith("rotation")]
            shift = np.tile(offset, (len(rows), 1))
            for n in moved:
                shift[:, "XYZ".index(channels[n][0])] = own[:, n] * CENTIMETRE
            local = turns([channels[n][0] for n in turned], own[:, turned])
            if parent is None:
                places.append(shift)
                frames.append(local)
            else:
                places.append(places[parent] + np.einsum("fij,fj->fi", frames[parent], shift))
                frames.append(frames[parent] @ local)
        return places

    def number(self, names):
        own = [joint[0] for joint in self.joints]
        for name in names:
            if name in own:
                return own.index(name)
        raise SystemExit(f"{self.name}: has no joint {' or '.join(names)}")

    def positions(self, rows):
        """Positions (F,3) by name: `left_elbow`, ...; `left_toe` and `left_hand` are where foot and hand point."""
        places = self.everywhere(rows)
        out = {"head": places[self.number(HEAD)], "neck": places[self.number(NECK)]}
        for side in SIDES:
            words = {"Side": side.capitalize(), "s": side[0], "S": side[0].upper()}
            for joint, names in NAMES.items():
                number = self.number([name.format(**words) for name in names])
                out[f"{side}_{joint}"] = places[number]
                end = {"ankle": "toe", "wrist": "hand"}.get(joint)
                if end is None:
                    continue
                known = [n for n, own in enumerate(self.joints) if own[0] == ENDS[joint].format(**words)]
                child = known or [n for n, own in enumerate(self.joints) if own[1] == number]
                out[f"{side}_{end}"] = places[child[0]] if child else places[number]
        return out
