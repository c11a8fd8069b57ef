#!/usr/bin/env python3
"""Publishes the person whom a webcam or a video shows: MediaPipe's 33 landmarks in the world, and where they are in the image.

    pip install './tools/clients/python[camera]'
    teleopd-camera                        # camera 0
    teleopd-camera --video tools/camera/clips/wave_and_box.mp4 --loop

The model is a pose landmarker of MediaPipe. `teleopd` makes it of networks that `npm ci --prefix tools/camera` installs; a file
(`pose_landmarker_*.task`) can be given instead. One person is followed. A camera whose image is mirrored, as a selfie camera's,
needs --mirrored: left and right would be exchanged.
"""

import argparse
import contextlib
import itertools
import os
import shutil
import signal
import subprocess
import sys
import time

from teleopd_client import DEFAULT_RUN_DIR, HELD, LAYOUT_MEDIAPIPE66, SkeletonPublisher, TeleopdError, lease_is_held

#: landmarkers that teleopd makes
MADE = ("full", "lite")
#: landmarks of a pose, in the world and in the image
LANDMARKS = 66
#: frames a second of a video whose file does not say
FPS = 30.0
#: fewest images a second by which a robot is engaged
RATE_MIN = 15


class Refused(Exception):
    """What is asked for cannot be done; the text says why."""


def made(name):
    """The path of the landmarker of this name, which `teleopd` makes if it is not there yet."""
    # A clone: the current folder, or the one that this file lies in.
    roots = [os.getcwd(), os.path.abspath(os.path.join(os.path.dirname(__file__), "..", "..", ".."))]
    root = next((root for root in roots if os.path.isfile(os.path.join(root, "tools", "camera", "package.json"))), None)
    built = os.path.join(root or "", "target", "release", "teleopd")
    program = os.environ.get("TELEOPD") or shutil.which("teleopd") or built
    if not os.path.isfile(program):
        raise Refused(
            f"--model {name}: teleopd makes it, and is neither on PATH nor built in the current folder: run `cargo build --release` in "
            "the clone and start again there, set TELEOPD to its path, or give a .task file"
        )
    folder = root
    run = subprocess.run([program, "landmarker", name], cwd=folder, capture_output=True, text=True)
    if run.returncode != 0:
        raise Refused(f"--model {name}: {run.stderr.strip()}")
    return os.path.join(folder or "", run.stdout.strip())


def detector(model):
    """A function of an RGB image and its time in ms: the rows of the layout and their visibilities, or None for nobody."""
    if model in MADE:
        model = made(model)
    if not os.path.isfile(model):
        raise Refused(f"--model {model}: no such file; it is {' or '.join(MADE)}, or a file pose_landmarker_*.task")
    try:
        import mediapipe
        from mediapipe.tasks.python import BaseOptions, vision
    except ImportError as error:
        raise Refused(f"MediaPipe is not installed ({error}): pip install 'teleopd-client[camera]'") from error
    options = vision.PoseLandmarkerOptions(
        base_options=BaseOptions(model_asset_path=model), running_mode=vision.RunningMode.VIDEO, num_poses=1
    )
    try:
        landmarker = vision.PoseLandmarker.create_from_options(options)
    except (RuntimeError, ValueError) as error:
        raise Refused(f"--model {model}: is not a pose landmarker: {error}") from error

    def detect(rgb, at_ms):
        image = mediapipe.Image(image_format=mediapipe.ImageFormat.SRGB, data=rgb)
        found = landmarker.detect_for_video(image, at_ms)
        if not found.pose_world_landmarks:
            return None
        world, marks, wide = found.pose_world_landmarks[0], found.pose_landmarks[0], rgb.shape[1] / rgb.shape[0]
        # Heights of the image from its middle.
        rows = [(mark.x, mark.y, mark.z) for mark in world] + [((mark.x - 0.5) * wide, mark.y - 0.5, 0.0) for mark in marks]
        return rows, 2 * [mark.visibility for mark in world]

    # Its threads end before Python does.
    detect.close = landmarker.close
    return detect


def images(camera, video, loop):
    """RGB images and the monotonic times at which they were seen, ns: those of a camera, or of a file at its own rate."""
    try:
        import cv2
    except ImportError as error:
        raise Refused(f"OpenCV is not installed ({error}): pip install 'teleopd-client[camera]'") from error
    name = f"--video {video}" if video else f"--camera {camera}"
    source = cv2.VideoCapture(video if video else camera)
    if not source.isOpened():
        hint = "" if video else " (`ls /dev/video*` shows what there is; --video FILE needs none)"
        raise Refused(f"{name}: cannot be opened{hint}")
    fps = source.get(cv2.CAP_PROP_FPS)
    period_ns = int(1e9 / (fps if 1.0 <= fps <= 240.0 else FPS))
    due_ns, shown, kept = time.monotonic_ns(), 0, []

    def back_and_there():
        """The images again, backwards and forwards, for ever: a jump from the last to the first would be no person's."""
        if kept:
            for n in itertools.cycle([*range(len(kept) - 2, 0, -1), *range(len(kept))]):
                yield cv2.imdecode(kept[n], cv2.IMREAD_COLOR)

    again = back_and_there()
    while True:
        ok, bgr = source.read()
        if ok and video and loop:
            kept.append(cv2.imencode(".jpg", bgr)[1])
        if not ok:
            if shown == 0:
                raise Refused(f"{name}: has no image")
            bgr = next(again, None)
            if bgr is None:
                return
        shown += 1
        if video:
            time.sleep(max(0.0, (due_ns - time.monotonic_ns()) * 1e-9))
            # One that is slower than its video does not catch up.
            due_ns = max(due_ns + period_ns, time.monotonic_ns())
        yield cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB), time.monotonic_ns()


def told(images_per_s, seen):
    """What the last second says to the user: whether somebody is seen, and whether the images are too few."""
    finding = "the camera sees a person" if seen > 0 else "the camera sees no person"
    slow = images_per_s < RATE_MIN
    hint = f" (at least {RATE_MIN} are needed; --model lite is quicker)" if slow else ""
    return (seen > 0, slow), f"{finding}, {images_per_s:.0f} images a second{hint}"


def follow(publisher, pictures, detect, mirrored=False, say=lambda text: None):
    """Publishes everybody who is seen, and says what changes; answers how many images showed somebody, and how many there were."""
    seen = shown = before_ms = 0
    since, before, known = time.monotonic(), (0, 0), None
    for rgb, at_ns in pictures:
        shown += 1
        passed = time.monotonic() - since
        if passed >= 1.0:
            kind, text = told((shown - before[0]) / passed, seen - before[1])
            if kind != known:
                say(text)
            since, before, known = time.monotonic(), (shown, seen), kind
        # The landmarker wants times that grow.
        before_ms = max(before_ms + 1, at_ns // 1_000_000)
        person = detect(rgb, before_ms)
        if person is None:
            continue
        positions, visibility = person
        if len(positions) != LANDMARKS:
            raise Refused(f"the model gives {len(positions) // 2} landmarks, not {LANDMARKS // 2}: it is not a pose landmarker")
        publisher.publish(positions, confidence=visibility, seen_ns=at_ns, mirrored=mirrored)
        seen += 1
    return seen, shown


def arguments(given):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--model", default="full", help="pose landmarker of MediaPipe: full (default), the quicker lite, or a file")
    source = parser.add_mutually_exclusive_group()
    source.add_argument("--camera", type=int, default=0, metavar="N", help="number of the camera (default: 0)")
    source.add_argument("--video", metavar="FILE", help="a video in place of a camera, at its own rate or as fast as its person is found")
    parser.add_argument("--loop", action="store_true", help="play the video there and back, for ever")
    parser.add_argument("--mirrored", action="store_true", help="the image is mirrored")
    parser.add_argument("--run-dir", default=DEFAULT_RUN_DIR, metavar="DIR", help="folder of the instance")
    return parser.parse_args(given)


def main(given=None):
    options = arguments(given)
    # In the background of a script SIGINT is ignored otherwise.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        if options.video and not os.path.isfile(options.video):
            raise Refused(f"--video {options.video}: no such file")
        landmarker = contextlib.closing(detector(options.model))
        with landmarker as detect, SkeletonPublisher(options.run_dir, layout=LAYOUT_MEDIAPIPE66) as publisher:
            print(f"publishing to {options.run_dir}; Ctrl-C ends", flush=True)
            if lease_is_held(options.run_dir):
                print(HELD, flush=True)
            pictures = images(options.camera, options.video, options.loop)
            seen, shown = follow(publisher, pictures, detect, options.mirrored, lambda text: print(text, flush=True))
    except KeyboardInterrupt:
        return 130
    except (Refused, TeleopdError) as error:
        print(f"teleopd-camera: {error}", file=sys.stderr)
        return 1
    print(f"a person was seen in {seen} of {shown} images" + ("; the video ended, and --loop repeats it" if options.video else ""))
    return 0


if __name__ == "__main__":
    sys.exit(main())
