// The camera. It frames the figures in every window shape, and the user can turn, move and zoom it. Constants
// without a source were chosen by eye: assumptions.

import * as THREE from "./three.module.min.js";

// Angles of each named view, rad: about the vertical, and above the horizon. The robot looks along x.
const VIEWS = { reset: [0.42, 0.16], front: [0, 0.1], side: [Math.PI / 2, 0.1] };
const PITCH = [-0.2, 1.5];
const DISTANCE_M = [0.6, 20];
// The camera backs off at once and comes nearer slowly. A stretched arm stays in the frame, and the view does not
// pump.
const BACK_S = 0.07, FOLLOW_S = 0.5, SHRINK_S = 8;
// A box that grows by no more than this stays the same, so that the picture comes to rest.
const SLACK_M = 0.01;
// Margin beside the figures, as a share of the view.
const ROOM = 0.055;

// Finds the smallest distance along `back` at which all `points` are visible, and the camera's place sideways and
// upwards. Each edge of the view is a plane. `tan` are their slopes: left, right, bottom, top.
function fit(points, count, right, up, back, tan, out) {
  let [l, r, b, t] = [Infinity, -Infinity, Infinity, -Infinity];
  for (let n = 0; n < count; n += 1) {
    const p = points[n];
    const x = p.dot(right), y = p.dot(up), z = p.dot(back);
    l = Math.min(l, x - tan.left * z);
    r = Math.max(r, x + tan.right * z);
    b = Math.min(b, y - tan.bottom * z);
    t = Math.max(t, y + tan.top * z);
  }
  // Right edge: x <= X + tan.right (Z - z), so r <= X + tan.right Z. The other edges are similar.
  const wide = (r - l) / (tan.left + tan.right), high = (t - b) / (tan.bottom + tan.top);
  out.z = Math.max(wide, high);
  out.x = (r - tan.right * out.z + l + tan.left * out.z) / 2;
  out.y = (t - tan.top * out.z + b + tan.bottom * out.z) / 2;
}

export class CameraRig {
  constructor() {
    this.camera = new THREE.PerspectiveCamera(32, 1, 0.05, 60);
    this.camera.up.set(0, 0, 1);
    [this.yaw, this.pitch] = VIEWS.reset;
    // While `auto` is on, the rig chooses place and distance. Zooming and moving turn it off.
    this.auto = true;
    this.kept = [new THREE.Box3(), new THREE.Box3()];
    this.corners = Array.from({ length: 16 }, () => new THREE.Vector3());
    [this.whole, this.middle, this.count] = [new THREE.Box3(), new THREE.Vector3(), 0];
    [this.right, this.up, this.back] = [new THREE.Vector3(), new THREE.Vector3(), new THREE.Vector3()];
    [this.wished, this.gone, this.centre] = [new THREE.Vector3(), new THREE.Vector3(), new THREE.Vector3()];
    // Camera position along right, up and back of its own view.
    this.place = new THREE.Vector3();
    this.seen = new THREE.Vector3();
    this.before = new THREE.Vector3();
    [this.isSettled, this.isStill] = [false, false];
    this.tan = { left: 1, right: 1, bottom: 1, top: 1 };
    this.size = { width: 1, height: 1, inset: { left: 0, right: 0, bottom: 0, top: 0 } };
  }

  // `inset` holds the widths in pixels that controls cover at each edge.
  resize(width, height, inset) {
    this.size = { width, height, inset };
    this.camera.aspect = width / Math.max(height, 1);
    this.camera.updateProjectionMatrix();
    const top = Math.tan(THREE.MathUtils.degToRad(this.camera.fov) / 2), side = top * this.camera.aspect;
    const share = (pixels, of) => Math.max(0.3, 1 - 2 * Math.min(pixels / Math.max(of, 1), 0.3) - 2 * ROOM);
    this.tan.left = side * share(inset.left, width);
    this.tan.right = side * share(inset.right, width);
    this.tan.bottom = top * share(inset.bottom, height);
    this.tan.top = top * share(inset.top, height);
    this.isSettled = false;
  }

  begin() {
    this.count = 0;
    this.whole.makeEmpty();
  }

  // Sets the `n`th box that must be visible. It grows at once and shrinks over seconds.
  see(n, box, dt) {
    if (box.isEmpty()) return;
    const kept = this.kept[n], keep = Math.exp(-dt / SHRINK_S);
    if (kept.isEmpty() || !this.isSettled) kept.copy(box);
    for (const axis of AXES) {
      const [low, high] = [box.min[axis] - kept.min[axis], kept.max[axis] - box.max[axis]];
      if (low < 0 || low > SLACK_M) kept.min[axis] = box.min[axis] - Math.max(0, low) * keep;
      if (high < 0 || high > SLACK_M) kept.max[axis] = box.max[axis] + Math.max(0, high) * keep;
    }
    for (let k = 0; k < 8; k += 1) {
      this.corners[this.count].set(k & 1 ? kept.max.x : kept.min.x, k & 2 ? kept.max.y : kept.min.y, k & 4 ? kept.max.z : kept.min.z);
      this.count += 1;
    }
    this.whole.union(kept);
  }

  // Updates the camera after `dt` seconds. If people walk about, a camera that was moved follows them.
  follow(dt, isWalking) {
    if (this.count === 0) return;
    this.whole.getCenter(this.middle);
    this.basis();
    if (this.auto) {
      fit(this.corners, this.count, this.right, this.up, this.back, this.tan, this.wished);
      const seconds = this.wished.z > this.place.z ? BACK_S : FOLLOW_S;
      this.place.lerp(this.wished, this.isSettled ? 1 - Math.exp(-dt / seconds) : 1);
      this.centre.copy(this.middle);
    } else if (isWalking) {
      this.gone.subVectors(this.middle, this.centre);
      const share = 1 - Math.exp(-dt / (3 * FOLLOW_S));
      this.place.x += this.gone.dot(this.right) * share;
      this.place.y += this.gone.dot(this.up) * share;
      this.place.z += this.gone.dot(this.back) * share;
      this.centre.addScaledVector(this.gone, share);
    }
    // True if the next picture would look the same.
    this.isStill = this.isSettled && this.before.distanceToSquared(this.place) < 1e-8;
    this.before.copy(this.place);
    this.isSettled = true;
    this.aim();
  }

  basis() {
    const [sy, cy, sp, cp] = [Math.sin(this.yaw), Math.cos(this.yaw), Math.sin(this.pitch), Math.cos(this.pitch)];
    this.back.set(cp * cy, cp * sy, sp);
    this.right.set(-sy, cy, 0);
    this.up.set(-sp * cy, -sp * sy, cp);
  }

  aim() {
    this.camera.position.set(0, 0, 0).addScaledVector(this.right, this.place.x).addScaledVector(this.up, this.place.y)
      .addScaledVector(this.back, this.place.z);
    this.camera.quaternion.setFromRotationMatrix(TURN.makeBasis(this.right, this.up, this.back));
    this.camera.updateMatrixWorld();
  }

  // Returns the distance of the figures' middle in front of the camera, m.
  distance() {
    return Math.max(this.place.z - this.centre.dot(this.back), DISTANCE_M[0]);
  }

  // Turns about the middle of the view, by pixels.
  turn(dx, dy) {
    this.basis();
    this.seen.set(this.place.x - this.centre.dot(this.right), this.place.y - this.centre.dot(this.up), this.place.z - this.centre.dot(this.back));
    this.yaw -= dx * 0.006;
    this.pitch = Math.min(PITCH[1], Math.max(PITCH[0], this.pitch + dy * 0.006));
    this.basis();
    this.place.set(this.seen.x + this.centre.dot(this.right), this.seen.y + this.centre.dot(this.up), this.seen.z + this.centre.dot(this.back));
    this.aim();
  }

  // Moves the view with the pointer, by pixels.
  move(dx, dy) {
    this.auto = false;
    const step = 2 * Math.tan(THREE.MathUtils.degToRad(this.camera.fov) / 2) * this.distance() / Math.max(this.size.height, 1);
    this.place.x -= dx * step;
    this.place.y += dy * step;
    this.aim();
  }

  zoom(factor) {
    this.auto = false;
    const middle = this.centre.dot(this.back), distance = this.distance() * factor;
    this.place.z = middle + Math.min(DISTANCE_M[1], Math.max(DISTANCE_M[0], distance));
    this.aim();
  }

  // Switches to a named view, which frames both figures again.
  view(name) {
    [this.yaw, this.pitch] = VIEWS[name];
    this.auto = true;
    this.isSettled = false;
  }
}

const AXES = ["x", "y", "z"], TURN = new THREE.Matrix4();
