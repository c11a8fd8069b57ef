"""Draws a body before a camera, with moderngl on EGL, without a display."""

import moderngl
import numpy as np

from body import COLOURS, unit

VERTEX = """#version 330
in vec3 place, normal, colour; uniform mat4 view; out vec3 at, up, paint;
void main() { gl_Position = view * vec4(place, 1); at = place; up = normal; paint = colour; }"""
# Two lamps and what is reflected by the room. The gamma is 2.
FRAGMENT = """#version 330
in vec3 at, up, paint; uniform vec3 eye; out vec4 drawn;
void main() {
  vec3 n = normalize(up), to_eye = normalize(eye - at), lamp = normalize(vec3(0.4, 1.0, 0.8));
  if (dot(n, to_eye) < 0) n = -n;
  float bright = 0.3 + 0.8 * max(dot(n, lamp), 0) + 0.25 * max(dot(n, normalize(vec3(-0.8, 0.2, 0.6))), 0);
  drawn = vec4(sqrt(paint * paint * bright + 0.06 * pow(max(dot(n, normalize(lamp + to_eye)), 0), 40)), 1);
}"""
NEAR_M, FAR_M = 0.1, 20.0
# Noise of a camera's sensor, of 255 levels. Assumption.
NOISE = 3.0


class Camera:
    """Where a camera stands and looks. Its axes: x right, y down, z away."""

    def __init__(self, eye, target, view_deg):
        away = unit(target - eye)
        right = unit(np.cross(away, [0, 1, 0]))
        self.eye, self.axes = eye, np.array([right, np.cross(away, right), away])
        # In image heights.
        self.focal = 0.5 / np.tan(np.radians(view_deg) / 2)

    def seen(self, points):
        return (points - self.eye) @ self.axes.T

    def matrix(self, width, height):
        turn = np.diag([1, -1, -1]) @ self.axes
        view = np.eye(4)
        view[:3, :3], view[:3, 3] = turn, -turn @ self.eye
        depth = FAR_M - NEAR_M
        lens = np.diag([2 * self.focal * height / width, 2 * self.focal, -(FAR_M + NEAR_M) / depth, 0])
        lens[2, 3], lens[3, 2] = -2 * FAR_M * NEAR_M / depth, -1
        return lens @ view


def room(random, angle, middle):
    """Corners of a floor, a wall behind the person and boxes before it: place, normal, colour."""
    corners = []

    def plane(a, b, c, d, colour):
        a, b, c, d = np.array([a, b, c, d], float)
        normal = unit(np.cross(b - a, d - a))
        corners.extend(np.concatenate([p, normal, colour]) for p in (a, b, c, a, c, d))

    floor, wall = random.uniform(0.3, 0.7, 3), random.uniform(0.4, 0.85, 3)
    for i in range(-6, 6):
        for j in range(-6, 6):
            plane([i, 0, j], [i, 0, j + 1], [i + 1, 0, j + 1], [i + 1, 0, j], floor + 0.04 * ((i + j) % 2))
    plane([-9, 0, -3], [9, 0, -3], [9, 6, -3], [-9, 6, -3], wall)
    for _ in range(random.integers(4, 18)):
        x, z, wide, tall = random.uniform(-4, 4), random.uniform(-2.9, -1.8), random.uniform(0.15, 0.6), random.uniform(0.2, 1.8)
        colour = random.uniform(0.15, 0.85, 3)
        plane([x, 0, z + wide], [x + wide, 0, z + wide], [x + wide, tall, z + wide], [x, tall, z + wide], colour)
        plane([x, tall, z + wide], [x + wide, tall, z + wide], [x + wide, tall, z], [x, tall, z], colour)
        plane([x, 0, z], [x, 0, z + wide], [x, tall, z + wide], [x, tall, z], colour)
    out = np.array(corners, np.float32)
    turn = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
    out[:, :3] = out[:, :3] @ turn.T + [middle[0], 0, middle[2]]
    out[:, 3:6] = out[:, 3:6] @ turn.T
    return out


class Studio:
    """Draws images of `width` x `height` pixels."""

    def __init__(self, width=640, height=480):
        self.size = (width, height)
        self.gl = moderngl.create_context(standalone=True, backend="egl")
        self.program = self.gl.program(vertex_shader=VERTEX, fragment_shader=FRAGMENT)
        smooth = [self.gl.renderbuffer(self.size, 3, samples=4)]
        self.smooth = self.gl.framebuffer(smooth, self.gl.depth_renderbuffer(self.size, samples=4))
        self.plain = self.gl.framebuffer([self.gl.renderbuffer(self.size, 3)])
        self.grain = np.random.default_rng(1).normal(0, NOISE, (height + 64, width + 64, 3)).astype(np.float32)

    def images(self, body, colours, turns, starts, camera, behind, random, light=1.0):
        """RGB images (height, width, 3) of each frame."""
        width, height = self.size
        self.program["view"].write(camera.matrix(width, height).T.astype("f4").tobytes())
        self.program["eye"].value = tuple(camera.eye)
        layout = (("3f 3f 3f", "place", "normal", "colour"),)
        back = self.gl.buffer(behind.tobytes())
        corners = body.corners.ravel()
        data = np.zeros((len(corners), 9), np.float32)
        data[:, 6:] = colours[body.paints.ravel()]
        front = self.gl.buffer(reserve=data.nbytes)
        arrays = [self.gl.vertex_array(self.program, [(buffer, *layout[0])]) for buffer in (back, front)]
        try:
            for turn, start in zip(turns, starts):
                places = body.vertices(turn, start)
                a, b, c = (places[body.corners[:, n]] for n in range(3))
                face = np.repeat(np.cross(b - a, c - a), 3, 0)
                normals = np.stack([np.bincount(corners, face[:, n], len(places)) for n in range(3)], 1)
                data[:, :3], data[:, 3:6] = places[corners], unit(normals)[corners]
                front.write(data.tobytes())
                self.smooth.use()
                self.gl.enable(moderngl.DEPTH_TEST)
                self.gl.clear(0.75, 0.78, 0.8)
                for array in arrays:
                    array.render()
                self.gl.copy_framebuffer(self.plain, self.smooth)
                image = np.frombuffer(self.plain.read(components=3), np.uint8).reshape(height, width, 3)[::-1]
                i, j = random.integers(64, size=2)
                yield np.clip(image * np.float32(light) + self.grain[i : i + height, j : j + width], 0, 255).astype(np.uint8)
        finally:
            for thing in (*arrays, back, front):
                thing.release()


def dyed(random):
    """Other skin, clothes and hair."""
    colours = COLOURS.copy()
    skins = np.array([[214, 166, 140], [230, 190, 165], [150, 105, 80], [95, 62, 45], [190, 140, 105]]) / 255
    hairs = np.array([[62, 42, 30], [25, 22, 20], [170, 130, 80], [120, 120, 120]]) / 255
    colours[0], colours[4] = skins[random.integers(len(skins))], hairs[random.integers(len(hairs))]
    colours[1:4] = random.uniform(0.08, 0.9, (3, 3))
    return colours
