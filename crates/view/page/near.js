// Draws the obstacles, and a line from each arm to the nearest part. The page and a headset use it.

import * as THREE from "./three.module.min.js";
import { solid } from "./solid.js";

// If two figures are nearer than this, a line joins their nearest points, mm. Chosen by eye.
const NEAR_MM = 150;

// Returns the boxes among the obstacles.
export function around(told) {
  const group = new THREE.Group();
  const wall = new THREE.MeshStandardMaterial({ color: 0x8090a0, transparent: true, opacity: 0.35 });
  for (const obstacle of told.obstacles.filter((one) => one.form === "box")) {
    const mesh = new THREE.Mesh(solid(obstacle), wall), [x, y, z, ...turn] = obstacle.pose;
    mesh.position.set(x, y, z);
    mesh.quaternion.set(...turn);
    group.add(mesh);
  }
  return group;
}

// A line for each arm.
export class NearLines {
  constructor(color) {
    this.places = new THREE.BufferAttribute(new Float32Array(12), 3);
    this.lines = new THREE.LineSegments(new THREE.BufferGeometry().setAttribute("position", this.places),
      new THREE.LineBasicMaterial({ color, depthTest: false, toneMapped: false }));
    this.lines.frustumCulled = false;
  }

  // An arm that is near nothing has a line without length.
  show(pair, isNear) {
    this.lines.visible = isNear;
    const places = this.places.array;
    places.set(pair);
    for (let at = 0; at < 12; at += 6) {
      const [x, y, z, ...to] = places.subarray(at, at + 6);
      if (1e3 * Math.hypot(to[0] - x, to[1] - y, to[2] - z) >= NEAR_MM) places.set([x, y, z], at + 3);
    }
    this.places.needsUpdate = true;
  }
}
