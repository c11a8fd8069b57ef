// A soft shadow without a shadow map. Each limb darkens a strip of the floor, softer with its height. Where
// strips overlap the darkest counts, so nothing is darkened twice. In metres. Constants without a source were
// chosen by eye: assumptions.

import * as THREE from "./three.module.min.js";

// Direction of the light: sideways shift per metre of height.
const LEAN = [0.32, 0.16];
// Widening of the strip's border, as a share of the height.
const SOFTENS = 0.16;
const PIXELS = 64;
// Vertices of each strip: two ends and a middle, eight corners.
const CORNERS = 8, TRIANGLES = [0, 1, 3, 0, 3, 2, 2, 3, 5, 2, 5, 4, 4, 5, 7, 4, 7, 6];

// Returns the texture of a disc that fades out towards its rim.
function disc() {
  const bytes = new Uint8Array(PIXELS * PIXELS * 4);
  for (let n = 0; n < PIXELS * PIXELS; n += 1) {
    const x = (n % PIXELS + 0.5) / PIXELS * 2 - 1, y = (Math.floor(n / PIXELS) + 0.5) / PIXELS * 2 - 1;
    const inside = Math.max(0, 1 - Math.hypot(x, y));
    bytes[4 * n + 3] = Math.round(255 * inside * inside * (3 - 2 * inside));
  }
  const texture = new THREE.DataTexture(bytes, PIXELS, PIXELS);
  [texture.magFilter, texture.minFilter, texture.needsUpdate] = [THREE.LinearFilter, THREE.LinearFilter, true];
  return texture;
}

export class LimbShadow {
  constructor(most) {
    this.most = most;
    const geometry = new THREE.BufferGeometry(), index = [];
    this.position = new THREE.BufferAttribute(new Float32Array(3 * CORNERS * most), 3).setUsage(THREE.DynamicDrawUsage);
    this.colour = new THREE.BufferAttribute(new Float32Array(4 * CORNERS * most), 4).setUsage(THREE.DynamicDrawUsage);
    const uv = new Float32Array(2 * CORNERS * most);
    for (let n = 0; n < most; n += 1) {
      [0, 0.5, 0.5, 1].forEach((u, pair) => uv.set([u, 0, u, 1], 2 * (CORNERS * n + 2 * pair)));
      index.push(...TRIANGLES.map((corner) => CORNERS * n + corner));
    }
    geometry.setAttribute("position", this.position);
    geometry.setAttribute("color", this.colour);
    geometry.setAttribute("uv", new THREE.BufferAttribute(uv, 2));
    geometry.setIndex(index);
    const material = new THREE.MeshBasicMaterial({
      map: disc(), vertexColors: true, transparent: true, depthWrite: false, toneMapped: false, side: THREE.DoubleSide, blending: THREE.CustomBlending,
      blendEquation: THREE.MaxEquation, blendSrc: THREE.OneFactor, blendDst: THREE.OneFactor,
    });
    this.mesh = new THREE.Mesh(geometry, material);
    this.mesh.frustumCulled = false;
    this.mesh.renderOrder = -3;
    [this.count, this.darkness] = [0, 0.3];
  }

  begin() {
    this.count = 0;
  }

  // Adds the shadow of a limb from (ax, ay, az) to (bx, by, bz).
  add(ax, ay, az, bx, by, bz, radius) {
    if (this.count >= this.most) return;
    const { position, colour, count } = this;
    const [fromX, fromY, toX, toY] = [ax - LEAN[0] * az, ay - LEAN[1] * az, bx - LEAN[0] * bz, by - LEAN[1] * bz];
    const length = Math.hypot(toX - fromX, toY - fromY);
    const [dx, dy] = length > 1e-4 ? [(toX - fromX) / length, (toY - fromY) / length] : [1, 0];
    for (let pair = 0; pair < 4; pair += 1) {
      const isFrom = pair < 2, height = Math.max(0, isFrom ? az : bz);
      const reach = radius * 1.35 + SOFTENS * height, dark = this.darkness * Math.min(1, radius * 2.2 / reach);
      const along = pair === 0 ? -reach : pair === 3 ? reach : 0;
      const [x, y] = isFrom ? [fromX, fromY] : [toX, toY];
      const at = CORNERS * count + 2 * pair;
      position.setXYZ(at, x + dx * along + dy * reach, y + dy * along - dx * reach, 0.001);
      position.setXYZ(at + 1, x + dx * along - dy * reach, y + dy * along + dx * reach, 0.001);
      colour.setXYZW(at, 0, 0, 0, dark);
      colour.setXYZW(at + 1, 0, 0, 0, dark);
    }
    this.count += 1;
  }

  end() {
    this.mesh.geometry.setDrawRange(0, TRIANGLES.length * this.count);
    this.position.needsUpdate = true;
    this.colour.needsUpdate = true;
  }
}
