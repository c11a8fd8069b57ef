// Floor and light: a grid that fades out, and the shadow on it. In metres. Constants without a source were chosen
// by eye: assumptions.

import * as THREE from "./three.module.min.js";
import { LimbShadow } from "./shadow.js";

const CELL_M = 0.5, REACH_M = 5;
// Side of the square that the shadow's light covers, and size of its map in pixels.
const LIT_M = 5, PIXELS = 1024;
// Largest number of limbs of both figures that cast a shadow.
const LIMBS_MAX = 160;

function grid(colour) {
  const positions = [], colours = [];
  const shade = new THREE.Color(colour);
  const vertex = (x, y) => {
    positions.push(x, y, 0);
    colours.push(shade.r, shade.g, shade.b, 0.45 * Math.max(0, 1 - Math.hypot(x, y) / REACH_M) ** 1.5);
  };
  // Each line has four pieces, so that it fades out.
  for (let line = -REACH_M; line <= REACH_M; line += CELL_M) {
    const half = Math.sqrt(REACH_M ** 2 - line ** 2), ends = [-half, -half / 2, 0, half / 2, half];
    for (let n = 0; n < 4 && half > 0; n += 1) {
      vertex(line, ends[n]);
      vertex(line, ends[n + 1]);
      vertex(ends[n], line);
      vertex(ends[n + 1], line);
    }
  }
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.Float32BufferAttribute(positions, 3));
  geometry.setAttribute("color", new THREE.Float32BufferAttribute(colours, 4));
  const material = new THREE.LineBasicMaterial({ vertexColors: true, transparent: true, depthWrite: false, toneMapped: false });
  return new THREE.LineSegments(geometry, material);
}

export class Floor {
  constructor(scene, isHigh) {
    Object.assign(this, { scene, isHigh, limbs: null, catcher: null });
    scene.add(new THREE.HemisphereLight(0xffffff, 0x8a93a0, 1.5));
    this.rim = new THREE.DirectionalLight(0xdfe9ff, 0.6);
    this.sun = new THREE.DirectionalLight(0xffffff, 1.9);
    scene.add(this.rim, this.rim.target, this.sun, this.sun.target);
    if (isHigh) this.castShadows();
    else {
      this.limbs = new LimbShadow(LIMBS_MAX);
      scene.add(this.limbs.mesh);
    }
    this.follow(0, 0);
  }

  castShadows() {
    const { sun } = this, eye = sun.shadow.camera;
    sun.castShadow = true;
    sun.shadow.mapSize.set(PIXELS, PIXELS);
    [eye.left, eye.right, eye.bottom, eye.top, eye.near, eye.far] = [-LIT_M / 2, LIT_M / 2, -LIT_M / 2, LIT_M / 2, 1, 10];
    [sun.shadow.bias, sun.shadow.normalBias, sun.shadow.radius] = [-0.0004, 0.01, 5];
    this.catcher = new THREE.Mesh(new THREE.CircleGeometry(REACH_M, 48), new THREE.ShadowMaterial({ depthWrite: false }));
    this.catcher.receiveShadow = true;
    this.catcher.position.z = -0.002;
    this.catcher.renderOrder = -3;
    this.scene.add(this.catcher);
  }

  paint(colour, darkness) {
    if (this.grid) this.scene.remove(this.grid);
    this.grid = grid(colour);
    this.grid.renderOrder = -2;
    if (this.catcher) this.catcher.material.opacity = darkness;
    if (this.limbs) this.limbs.darkness = darkness * 1.3;
    this.scene.add(this.grid);
  }

  // Moves light and floor to the figures.
  follow(x, y) {
    this.sun.position.set(x + 2.2, y + 1.2, 5);
    this.sun.target.position.set(x, y, 0.6);
    this.rim.position.set(x - 3, y - 2, 3);
    this.rim.target.position.set(x, y, 0.6);
    this.catcher?.position.set(x, y, -0.002);
    this.grid?.position.set(Math.round(x / CELL_M) * CELL_M, Math.round(y / CELL_M) * CELL_M, 0);
  }
}
