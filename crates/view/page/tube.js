// A smooth tube along a path of moving joints: an arm, a leg, a trunk. Its vertices are computed again for every
// picture, in arrays that are allocated once. Constants without a source were chosen by eye: assumptions.

import * as THREE from "./three.module.min.js";

// Reach of a bend along the path, in segments. Elbows and knees are round.
const SOFT = 0.16;
const [P, Q, T, U, V] = Array.from({ length: 5 }, () => new THREE.Vector3());

// Returns the point at `s` of a path. Joint n is at s = n. Beyond its ends the path continues straight.
function pointAt(joints, path, s, out) {
  const n = Math.min(path.length - 2, Math.max(0, Math.floor(s)));
  return out.lerpVectors(joints[path[n]], joints[path[n + 1]], s - n);
}

export class Tube {
  // `path` lists joints. `stations` are [s, half the width, half the depth, colour] along it, in the order of s.
  constructor(path, stations, material, around) {
    this.path = path;
    this.stations = stations;
    this.around = around;
    const count = stations.length * (around + 1);
    const geometry = new THREE.BufferGeometry();
    this.position = new THREE.BufferAttribute(new Float32Array(3 * count), 3).setUsage(THREE.DynamicDrawUsage);
    this.normal = new THREE.BufferAttribute(new Float32Array(3 * count), 3).setUsage(THREE.DynamicDrawUsage);
    geometry.setAttribute("position", this.position);
    geometry.setAttribute("normal", this.normal);
    const colours = new Float32Array(3 * count);
    stations.forEach(([, , , colour], ring) => {
      for (let k = 0; k <= around; k += 1) colour.toArray(colours, 3 * (ring * (around + 1) + k));
    });
    geometry.setAttribute("color", new THREE.BufferAttribute(colours, 3));
    const index = [];
    for (let ring = 0; ring + 1 < stations.length; ring += 1) {
      for (let k = 0; k < around; k += 1) {
        const [a, b] = [ring * (around + 1) + k, (ring + 1) * (around + 1) + k];
        index.push(a, a + 1, b + 1, a, b + 1, b);
      }
    }
    geometry.setIndex(index);
    this.circle = Array.from({ length: around + 1 }, (_, k) => [Math.cos(2 * Math.PI * k / around), Math.sin(2 * Math.PI * k / around)]);
    this.mesh = new THREE.Mesh(geometry, material);
    this.mesh.frustumCulled = false;
  }

  // `width` returns the direction of the width at s, or is one direction for all. `size` scales every ring.
  update(joints, width, size) {
    const { path, stations, around, position, normal, circle } = this;
    for (let ring = 0; ring < stations.length; ring += 1) {
      const [s, wide, deep] = stations[ring];
      pointAt(joints, path, s - SOFT, T);
      pointAt(joints, path, s + SOFT, Q);
      pointAt(joints, path, s, P).multiplyScalar(2).add(T).add(Q).multiplyScalar(0.25);
      T.subVectors(Q, T).normalize();
      width(s, U);
      U.addScaledVector(T, -U.dot(T)).normalize();
      V.crossVectors(T, U);
      // The rate at which the tube narrows tilts its normals along it.
      const before = stations[Math.max(0, ring - 1)], after = stations[Math.min(stations.length - 1, ring + 1)];
      const run = Math.max(1e-3, Q.distanceTo(P)) / SOFT * (after[0] - before[0]);
      const slope = Math.max(-4, Math.min(4, size * (before[1] - after[1]) / run));
      for (let k = 0; k <= around; k += 1) {
        const [c, d] = circle[k], at = ring * (around + 1) + k;
        const [a, b] = [size * wide * c, size * deep * d];
        position.setXYZ(at, P.x + a * U.x + b * V.x, P.y + a * U.y + b * V.y, P.z + a * U.z + b * V.z);
        const [x, y] = [c * deep, d * wide], flat = slope * Math.hypot(x, y);
        normal.setXYZ(at, x * U.x + y * V.x + flat * T.x, x * U.y + y * V.y + flat * T.y, x * U.z + y * V.z + flat * T.z);
      }
    }
    position.needsUpdate = true;
    normal.needsUpdate = true;
  }
}
