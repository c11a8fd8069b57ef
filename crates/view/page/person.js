// The person: a figure of round limbs around the 22 joints of SMPL. It allocates nothing while it moves.
// Constants without a source were chosen by eye: assumptions.

import * as THREE from "./three.module.min.js";
import { capsule, ellipsoid, lathe, merged } from "./solid.js";
import { Tube } from "./tube.js";

const JOINTS = 22;
const [PELVIS, SPINE3, NECK, HEAD] = [0, 9, 12, 15];
const HIPS = [1, 2], KNEES = [4, 5], ANKLES = [7, 8], FEET = [10, 11], SHOULDERS = [16, 17], ELBOWS = [18, 19], WRISTS = [20, 21];
// Trunk length of the person with the measures below, m. Other persons are scaled by theirs.
const TRUNK_M = 0.5;
// Height of each joint above the surface below it, m: soles under feet and ankles.
const ABOVE = new Float32Array(JOINTS).fill(0.05);
for (const n of ANKLES) ABOVE[n] = 0.085;
for (const n of FEET) ABOVE[n] = 0.025;
// Time constants, s. The hip direction is smoothed. The floor sinks at once and rises slowly, so a jump looks
// like a jump.
const HEADING_S = 0.25, FLOOR_S = 1.5;
// A larger move between two frames means another person, or one who was put elsewhere, m.
const JUMP_M = 1;

// [s, half the width, half the depth] along each path, m. Where the colour changes, two rings are at the same
// place.
const ARM = [[0.1, 0.03], [0.35, 0.05], [0.7, 0.057], [0.9, 0.06], [1.04, 0.06], [1.18, 0.054], [1.4, 0.048], [1.65, 0.044], [1.88, 0.041],
  [2.0, 0.04], [2.14, 0.043], [2.3, 0.043], [2.55, 0.037], [2.8, 0.031], [2.93, 0.029], [3.0, 0.026]];
const LEG = [[-0.3, 0.02], [-0.26, 0.055], [-0.16, 0.078, 0.085], [-0.04, 0.09, 0.1], [0.12, 0.092, 0.1], [0.3, 0.085, 0.088], [0.55, 0.071], [0.8, 0.059], [0.93, 0.056],
  [1.0, 0.056], [1.1, 0.053], [1.28, 0.057], [1.5, 0.053], [1.75, 0.043], [1.95, 0.039], [2.06, 0.042]];
// From the middle of the hips at 0 to the neck at 4 and the skull at 5.
const TRUNK = [[-0.5, 0.02, 0.02], [-0.42, 0.06, 0.05], [-0.22, 0.12, 0.082], [0.1, 0.158, 0.1], [0.5, 0.16, 0.106], [0.85, 0.15, 0.102], [0.85, 0.155, 0.108],
  [1.25, 0.144, 0.1], [1.8, 0.146, 0.1], [2.4, 0.158, 0.109], [2.9, 0.169, 0.114], [3.3, 0.172, 0.112], [3.6, 0.155, 0.1], [3.82, 0.12, 0.085],
  [3.96, 0.078, 0.071], [4.0, 0.066, 0.066], [4.0, 0.056, 0.058], [4.3, 0.052, 0.055], [5.0, 0.05, 0.056], [5.5, 0.04, 0.045]];
const TROUSERS_END = 6, COLLAR = 16;
// Computed joints: the trunk's curve, and the upper end of the neck.
const [HIP, WAIST, RIBS, CHEST, SKULL] = [22, 23, 24, 25, 26], MADE = 5;

// Places in the server's `turns`: a hand has four numbers of a rotation and its closure.
const HAND_FLOATS = 5, HEAD_AT = 10;
// From the wrist to the knuckles, m, and how far the fingers of a fist are bent, rad.
const KNUCKLES_M = 0.075, CLOSED_RAD = 2.3;

// Limbs that cast a shadow: from joint to joint, with a radius in m.
const SHADOWS = [...[0, 1].flatMap((side) => [[SHOULDERS[side], ELBOWS[side], 0.05], [ELBOWS[side], WRISTS[side], 0.045], [HIPS[side], KNEES[side], 0.085],
  [KNEES[side], ANKLES[side], 0.06], [ANKLES[side], FEET[side], 0.06]]), [PELVIS, NECK, 0.15], [HEAD, HEAD, 0.11]];

const [A, B, C, D] = [0, 1, 2, 3].map(() => new THREE.Vector3());
const M = new THREE.Matrix4(), FLOOR = new THREE.Plane(new THREE.Vector3(0, 0, 1), 0);

function shaded(colour, factor) {
  return new THREE.Color(colour).multiplyScalar(factor);
}

export class Person {
  // `colour` is the colour of the clothes. The other colours are derived from it.
  constructor(colour, isHigh) {
    this.group = new THREE.Group();
    this.material = isHigh ? new THREE.MeshStandardMaterial({ vertexColors: true, roughness: 0.75 }) : new THREE.MeshLambertMaterial({ vertexColors: true });
    const around = isHigh ? 24 : 12;
    this.joints = Array.from({ length: JOINTS + MADE }, () => new THREE.Vector3());
    this.raw = new Float32Array(3 * JOINTS);
    this.box = new THREE.Box3();
    [this.size, this.up] = [1, new THREE.Vector3(0, 0, 1)];
    this.lateral = new THREE.Vector3(0, 1, 0);
    this.shoulders = new THREE.Vector3(0, 1, 0);
    this.front = new THREE.Vector3(1, 0, 0);
    [this.heading, this.floor, this.start] = [null, null, null];
    const [shirt, skin, trousers] = [new THREE.Color(colour), shaded(colour, 1).lerp(new THREE.Color("#ffe9d2"), 0.72), shaded(colour, 0.2).lerp(new THREE.Color("#39424f"), 0.75)];
    const worn = (stations, paint) => stations.map(([s, wide, deep], n) => [s, wide, deep ?? wide, paint(n)]);
    this.trunk = new Tube([HIP, WAIST, RIBS, CHEST, NECK, SKULL], worn(TRUNK, (n) => (n < TROUSERS_END ? trousers : n < COLLAR ? shirt : skin)), this.material, around + 4);
    this.arms = [0, 1].map((side) => new Tube([CHEST, SHOULDERS[side], ELBOWS[side], WRISTS[side]], worn(ARM, () => shirt), this.material, around));
    this.legs = [0, 1].map((side) => new Tube([HIPS[side], KNEES[side], ANKLES[side]], worn(LEG, () => trousers), this.material, around));
    const rigid = (pieces) => {
      const mesh = new THREE.Mesh(merged(pieces), this.material);
      mesh.matrixAutoUpdate = false;
      return mesh;
    };
    const paint = (c) => `#${c.getHexString()}`;
    const dark = paint(shaded(colour, 0.06).lerp(new THREE.Color("#20262e"), 0.6));
    this.hands = [0, 1].map(() => rigid(palm(paint(skin))));
    this.fingers = [0, 1].map(() => rigid(fingers(paint(skin))));
    this.shoes = [0, 1].map(() => rigid(shoe(dark)));
    this.head = rigid(head(paint(skin), dark));
    const meshes = [this.trunk.mesh, ...this.arms.map((arm) => arm.mesh), ...this.legs.map((leg) => leg.mesh), ...this.hands, ...this.fingers, ...this.shoes, this.head];
    for (const mesh of meshes) [mesh.castShadow, mesh.receiveShadow] = [true, true];
    this.group.add(...meshes);
  }

  // `positions` are the joints in the client's frame. `turns` are hands and head, as the server sends them. `placing` tells where they go: beside, overlaid or world.
  // `root` is a place in the robot's frame. It is for the pelvis, or for the middle of the shoulders of an
  // overlaid person.
  update(positions, turns, placing, root, dt) {
    this.turns = turns;
    if (Math.hypot(positions[0] - this.raw[0], positions[1] - this.raw[1]) > JUMP_M) this.start = null;
    this.raw.set(positions);
    for (let n = 0; n < JOINTS; n += 1) this.joints[n].fromArray(positions, 3 * n);
    this.size = Math.min(1.6, Math.max(0.5, A.subVectors(this.joints[NECK], this.joints[PELVIS]).length() / TRUNK_M || 1));
    this.turn(placing, dt);
    this.place(placing, root, dt);
    this.draw();
    this.bound();
  }

  // Resets the smoothing, because the next pose does not follow the last one.
  forget() {
    [this.heading, this.floor, this.start] = [null, null, null];
  }

  // Turns the hips to face where the robot faces. In the world placing they keep their direction.
  turn(placing, dt) {
    A.subVectors(this.joints[HIPS[0]], this.joints[HIPS[1]]);
    const now = Math.atan2(-A.x, A.y);
    if (this.heading === null) this.heading = now;
    if (Number.isFinite(now)) this.heading += Math.atan2(Math.sin(now - this.heading), Math.cos(now - this.heading)) * (1 - Math.exp(-dt / HEADING_S));
    const by = placing === "world" ? 0 : -this.heading, [c, s] = [Math.cos(by), Math.sin(by)];
    for (const joint of this.joints) joint.set(c * joint.x - s * joint.y, s * joint.x + c * joint.y, joint.z);
  }

  // Places the person on the floor at `root`, or with the shoulders at the robot's.
  place(placing, root, dt) {
    let low = Infinity;
    for (let n = 0; n < JOINTS; n += 1) low = Math.min(low, this.joints[n].z - ABOVE[n] * this.size);
    if (this.floor === null || low < this.floor || low - this.floor < 0.001) this.floor = low;
    this.floor += (low - this.floor) * (1 - Math.exp(-dt / FLOOR_S));
    if (placing === "overlaid") A.addVectors(this.joints[SHOULDERS[0]], this.joints[SHOULDERS[1]]).multiplyScalar(0.5);
    else A.copy(this.joints[PELVIS]);
    if (placing !== "world") this.start = null;
    else A.copy(this.start ??= A.clone());
    A.subVectors(root, A);
    if (placing !== "overlaid") A.z = -this.floor;
    for (const joint of this.joints) joint.add(A);
  }

  // The trunk is a parabola from the hips through the spine to the neck, because layouts place their spines
  // differently.
  make() {
    const { joints, size } = this;
    const low = joints[HIP].addVectors(joints[HIPS[0]], joints[HIPS[1]]).multiplyScalar(0.5), high = joints[NECK], middle = joints[SPINE3];
    const at = Math.min(0.8, Math.max(0.2, A.subVectors(middle, low).length() / Math.max(1e-3, B.subVectors(high, low).length())));
    // The bend is the spine's distance from the straight line, limited to a real spine's.
    C.lerpVectors(low, high, at);
    C.subVectors(middle, C).clampLength(0, 0.12 * size).divideScalar(4 * at * (1 - at));
    [WAIST, RIBS, CHEST].forEach((n, k) => joints[n].lerpVectors(low, high, (k + 1) / 4).addScaledVector(C, (k + 1) * (3 - k) / 4));
    A.subVectors(joints[HEAD], high).normalize().addScaledVector(B.subVectors(high, joints[CHEST]).normalize(), 0.6).normalize();
    joints[SKULL].copy(high).addScaledVector(A, 0.08 * size);
  }

  draw() {
    this.make();
    const { joints, size, lateral, shoulders, front } = this;
    lateral.subVectors(joints[HIPS[0]], joints[HIPS[1]]).normalize();
    shoulders.subVectors(joints[SHOULDERS[0]], joints[SHOULDERS[1]]).normalize();
    A.subVectors(joints[NECK], joints[HIP]).normalize();
    front.crossVectors(shoulders, A).normalize();
    this.trunk.update(joints, this.widthOfTrunk ??= (s, out) => out.lerpVectors(lateral, shoulders, Math.min(1, Math.max(0, s / 3.4))), size);
    for (let side = 0; side < 2; side += 1) {
      this.arms[side].update(joints, this.widthOfArm ??= (s, out) => out.copy(front).addScaledVector(this.up, 0.3), size);
      this.legs[side].update(joints, this.widthOfLeg ??= (s, out) => out.copy(lateral), size);
      this.placeHand(side);
      this.placeShoe(side);
    }
    if (this.isKnown(HEAD_AT)) {
      this.turned(B.set(1, 0, 0), HEAD_AT);
      this.turned(A.set(0, 0, 1), HEAD_AT);
    } else {
      // The head points up from the neck. The face points where the chest points.
      A.subVectors(joints[SKULL], joints[NECK]).normalize();
      B.copy(front).addScaledVector(A, -front.dot(A)).normalize();
    }
    this.rigid(this.head, joints[SKULL], B, C.crossVectors(A, B), A);
  }

  // Returns true if the rotation at this place of `turns` is known.
  isKnown(at) {
    return this.turns[at] !== 0 || this.turns[at + 1] !== 0 || this.turns[at + 2] !== 0 || this.turns[at + 3] !== 0;
  }

  // Turns a direction of the T-pose by the rotation at this place, from the chest's frame to the scene's.
  turned(direction, at) {
    const { front, shoulders } = this, { x, y, z } = direction.applyQuaternion(Q.fromArray(this.turns, at).normalize());
    D.crossVectors(front, shoulders);
    return direction.copy(front).multiplyScalar(x).addScaledVector(shoulders, y).addScaledVector(D, z);
  }

  // In the T-pose the left arm points left and the right arm right, and both thumbs forwards. Without a rotation the hand
  // continues its forearm, and its thumb points forwards, or upwards if the arm itself points forwards.
  placeHand(side) {
    const { joints, front, size } = this, at = HAND_FLOATS * side, wrist = joints[WRISTS[side]];
    if (this.isKnown(at)) {
      this.turned(A.set(0, 1 - 2 * side, 0), at);
      this.turned(B.set(1, 0, 0), at);
    } else {
      A.subVectors(wrist, joints[ELBOWS[side]]).normalize();
      const along = Math.abs(A.dot(front));
      B.copy(front).multiplyScalar(1 - along).setZ(B.z + along);
      B.addScaledVector(A, -A.dot(B)).normalize();
    }
    this.rigid(this.hands[side], wrist, A, B, C.crossVectors(A, B));
    // The fingers bend from the knuckles towards the palm.
    D.copy(wrist).addScaledVector(A, KNUCKLES_M * size);
    const bend = CLOSED_RAD * this.turns[at + 4] * (1 - 2 * side);
    A.multiplyScalar(Math.cos(bend)).addScaledVector(C, Math.sin(bend));
    this.rigid(this.fingers[side], D, A, B, C.crossVectors(A, B));
  }

  // The sole is level if the shin is upright, although the line from ankle to toes slopes down.
  placeShoe(side) {
    const { joints, lateral, size } = this;
    D.subVectors(joints[KNEES[side]], joints[ANKLES[side]]).normalize();
    A.subVectors(joints[FEET[side]], joints[ANKLES[side]]).addScaledVector(D, 0.06 * size);
    if (A.lengthSq() < 1e-6) A.copy(this.front);
    A.normalize();
    C.crossVectors(A, lateral).normalize();
    B.crossVectors(C, A);
    D.copy(joints[ANKLES[side]]).addScaledVector(C, -0.085 * size);
    this.rigid(this.shoes[side], D, A, B, C);
  }

  rigid(mesh, at, x, y, z) {
    const { size } = this;
    mesh.matrix.copy(M.makeBasis(x, y, z)).scale(SCALE.setScalar(size)).setPosition(at);
    mesh.matrixWorldNeedsUpdate = true;
  }

  bound() {
    const { box, joints, size } = this;
    box.makeEmpty();
    for (let n = 0; n < JOINTS; n += 1) box.expandByPoint(joints[n]);
    box.expandByScalar(0.07 * size);
    // Includes the crown, and the hands beyond the wrists.
    box.expandByPoint(A.copy(joints[SKULL]).setZ(joints[SKULL].z + 0.2 * size));
    for (let side = 0; side < 2; side += 1) {
      A.subVectors(joints[WRISTS[side]], joints[ELBOWS[side]]).normalize();
      box.expandByPoint(A.multiplyScalar(0.2 * size).add(joints[WRISTS[side]]));
    }
    box.min.z = Math.max(0, box.min.z);
  }

  // An overlaid person is transparent, and the part below the floor is cut off.
  overlay(isOn) {
    const { material } = this;
    [material.transparent, material.opacity, material.clippingPlanes] = [isOn, isOn ? 0.6 : 1, isOn ? [FLOOR] : null];
    material.needsUpdate = true;
  }

  // Adds the shadows of limbs, trunk and head.
  shade(limbs) {
    const { joints, size } = this;
    for (const [from, to, radius] of SHADOWS) {
      const [a, b] = [joints[from], joints[to]];
      limbs.add(a.x, a.y, a.z, b.x, b.y, b.z, radius * size);
    }
  }

  dispose() {
    this.group.traverse((mesh) => mesh.geometry?.dispose());
    this.material.dispose();
  }
}

const SCALE = new THREE.Vector3(), Q = new THREE.Quaternion();

// Builds a hand without its fingers along x from the wrist, with the thumb towards y. Both hands have the same shape: in
// their frames the thumb is on the same side.
function palm(colour) {
  const middle = ellipsoid([0.058, 0.04, 0.019]).translate(0.045, 0, 0);
  const thumb = capsule([0.03, 0.03, 0], [0.085, 0.056, 0], 0.015, 0.011);
  const wrist = capsule([-0.02, 0, 0], [0.02, 0, 0], 0.027, 0.026);
  return [middle, thumb, wrist].map((geometry) => ({ geometry, colour }));
}

// Builds four fingers along x from the knuckles.
function fingers(colour) {
  return [{ geometry: capsule([0, 0, 0], [0.075, 0, 0], 0.024, 0.016).scale(1, 1.35, 0.62), colour }];
}

// Builds a shoe along x from the heel to the toes, with the sole at z = 0.
function shoe(colour) {
  const sole = capsule([-0.035, 0, 0.04], [0.135, 0, 0.034], 0.042, 0.035).scale(1, 1.08, 1);
  const ankle = capsule([-0.005, 0, 0.04], [0, 0, 0.1], 0.042, 0.034);
  return [sole, ankle].map((geometry) => ({ geometry, colour }));
}

// Builds a head from the upper end of the neck: the face towards x, the crown towards z.
function head(skin, dark) {
  const egg = [[0, -0.05], [0.03, -0.048], [0.052, -0.03], [0.07, 0.005], [0.087, 0.05], [0.093, 0.09], [0.089, 0.125], [0.07, 0.158], [0.04, 0.178], [0, 0.185]];
  const skull = lathe(egg, { stretch: [1, 0.8] }).rotateY(0.06).translate(0.018, 0, 0);
  const nose = capsule([0.102, 0, 0.075], [0.112, 0, 0.05], 0.008, 0.013);
  const cap = egg.slice(2).map(([radius, height]) => [radius * 1.05 + 0.002, height * 1.03]);
  const hair = lathe(cap, { stretch: [1, 0.83] }).rotateY(-0.42).translate(-0.026, 0, 0.022);
  const eyes = [1, -1].map((side) => ellipsoid([0.006, 0.008, 0.011]).translate(0.101, side * 0.03, 0.082));
  const ears = [1, -1].map((side) => ellipsoid([0.018, 0.011, 0.026]).translate(0.012, side * 0.075, 0.062));
  const of = (colour) => (geometry) => ({ geometry, colour });
  return [...[skull, nose, ...ears].map(of(skin)), ...[hair, ...eyes].map(of(dark))];
}
