"""A video of a stick figure, published by `mediapipe_camera` with a detector that finds the figure's left wrist by its colour:
everything but the model. Arguments: the instance's folder, and a folder for the video."""

import math
import sys

import cv2
import mediapipe_camera as camera
import numpy as np

SIZE, FPS, FRAMES, SWING = 240, 30, 900, 120
RED = (0, 0, 255)  # BGR


def figure(angle):
    """MediaPipe's world landmarks of a person in T-pose whose left arm is raised by `angle`, rad; m, x right, y down, z away."""
    marks = np.zeros((33, 3))
    marks[0] = (0, -0.65, -0.1)
    for i in (*range(1, 7), 9, 10):
        marks[i] = (0.03 if i in (1, 2, 3, 9) else -0.03, -0.66, -0.09)
    for side, first in ((1, 0), (-1, 1)):
        marks[7 + first] = (0.08 * side, -0.65, 0)
        marks[11 + first] = (0.18 * side, -0.45, 0)
        reach = np.array([math.cos(angle), -math.sin(angle), 0]) if side == 1 else np.array([-1.0, 0, 0])
        marks[13 + first] = marks[11 + first] + 0.28 * reach
        for i in (15, 17, 19, 21):
            marks[i + first] = marks[11 + first] + (0.53 if i == 15 else 0.6) * reach
        marks[23 + first] = (0.1 * side, 0, 0)
        marks[25 + first] = (0.1 * side, 0.42, 0)
        marks[27 + first] = (0.1 * side, 0.85, 0)
        marks[29 + first] = (0.1 * side, 0.9, 0.05)
        marks[31 + first] = (0.1 * side, 0.92, -0.12)
    return marks


def at(mark):
    return int(SIZE / 2 + mark[0] * SIZE / 2.4), int(SIZE / 2 + mark[1] * SIZE / 2.4)


def render(path):
    video = cv2.VideoWriter(path, cv2.VideoWriter_fourcc(*"MJPG"), FPS, (SIZE, SIZE))
    for n in range(FRAMES):
        image = np.zeros((SIZE, SIZE, 3), np.uint8)
        marks = figure(0.6 * math.sin(2 * math.pi * n / SWING))
        for a, b in ((11, 12), (11, 13), (13, 15), (12, 14), (14, 16), (11, 23), (12, 24), (23, 24), (23, 27), (24, 28)):
            cv2.line(image, at(marks[a]), at(marks[b]), (255, 255, 255), 2)
        cv2.circle(image, at(marks[15]), 6, RED, -1)
        video.write(image)
    video.release()


def detect(rgb, at_ms):
    red = (rgb[..., 0] > 150) & (rgb[..., 1] < 100) & (rgb[..., 2] < 100)
    if not red.any():
        return None
    y, x = (values.mean() for values in np.nonzero(red))
    shoulder = at(figure(0)[11])
    # Pixels repeat where the arm turns around, and numbers that repeat are those of a tracker that is stuck: real ones tremble.
    tremble = 2e-4 * np.sin(at_ms * 0.7 + np.arange(99)).reshape(33, 3)
    marks = figure(math.atan2(shoulder[1] - y, x - shoulder[0])) + tremble
    # The image is 2.4 m high.
    return np.concatenate([marks, marks / 2.4 * [1, 1, 0]]), [1.0] * 66


run_dir, folder = sys.argv[1:]
video = f"{folder}/figure.avi"
render(video)
detect.close = lambda: None
camera.detector = lambda model: detect
sys.exit(camera.main(["--model", "by colour", "--video", video, "--run-dir", run_dir]))
