// Geometries of parts around the origin of their frames. Round parts stand along z. Lengths in m. Constants
// without a source were chosen by eye: assumptions.

import * as THREE from "./three.module.min.js";

// Corners of a circle and rings of a rounding. Software rendering uses fewer.
const DETAIL = { around: 32, rings: 4 };

// Returns the number of corners of a circle with this radius, m. Small circles need fewer, large ones more.
function sides(radius) {
  return Math.max(6, Math.round(DETAIL.around * Math.min(2, Math.sqrt(radius / 0.06))));
}

export function coarse() {
  Object.assign(DETAIL, { around: 12, rings: 2 });
}

// A sharper bend of a profile stays an edge, rad.
const SHARP = 0.6;

// Turns a profile of [radius, height] about z, listed up its outside from the bottom. The outline is a
// superellipse.
export function lathe(profile, { stretch = [1, 1], squareness = 2 } = {}) {
  const around = squareness > 2 ? DETAIL.around : sides(Math.max(...profile.map(([radius]) => radius)));
  const positions = [], normals = [], index = [];
  const outline = Array.from({ length: around + 1 }, (_, n) => {
    const angle = 2 * Math.PI * n / around, power = 2 / squareness;
    const [c, s] = [Math.cos(angle), Math.sin(angle)];
    const bent = (x, exponent) => Math.sign(x) * Math.abs(x) ** exponent;
    return { x: bent(c, power) * stretch[0], y: bent(s, power) * stretch[1], nx: bent(c, 2 - power) / stretch[0], ny: bent(s, 2 - power) / stretch[1] };
  });
  const slopes = profile.slice(1).map(([r, z], n) => Math.atan2(z - profile[n][1], r - profile[n][0]));
  const ring = (n, slope) => {
    const [radius, height] = profile[n];
    for (const { x, y, nx, ny } of outline) {
      positions.push(radius * x, radius * y, height);
      const flat = Math.hypot(nx, ny) || 1;
      normals.push(Math.sin(slope) * nx / flat, Math.sin(slope) * ny / flat, -Math.cos(slope));
    }
    return positions.length / 3 - outline.length;
  };
  let below = ring(0, slopes[0]);
  slopes.forEach((slope, n) => {
    const next = slopes[n + 1] ?? slope;
    const bend = Math.atan2(Math.sin(next - slope), Math.cos(next - slope));
    const isEdge = Math.abs(bend) > SHARP;
    const above = ring(n + 1, isEdge ? slope : slope + bend / 2);
    for (let k = 0; k < around; k += 1) index.push(below + k, below + k + 1, above + k + 1, below + k, above + k + 1, above + k);
    below = isEdge ? ring(n + 1, next) : above;
  });
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.Float32BufferAttribute(positions, 3));
  geometry.setAttribute("normal", new THREE.Float32BufferAttribute(normals, 3));
  geometry.setIndex(index);
  return geometry;
}

function arc(radius, x, z, from, to) {
  return Array.from({ length: DETAIL.rings + 1 }, (_, n) => {
    const angle = from + (to - from) * n / DETAIL.rings;
    return [Math.max(0, x + radius * Math.cos(angle)), z + radius * Math.sin(angle)];
  });
}

// Builds a cone from one radius at the bottom to another at the top, with rounded edges.
export function cone(radius, top, length, edge) {
  const round = Math.min(edge, radius, top, length / 2), half = length / 2, right = Math.PI / 2;
  if (round <= 0) return lathe([[0, -half], [radius, -half], [top, half], [0, half]]);
  const tilt = Math.atan2(radius - top, length);
  return lathe([[0, -half], ...arc(round, radius - round, -half + round, -right, tilt),
    ...arc(round, top - round, half - round, tilt, right), [0, half]]);
}

// Builds two spheres around `a` and `b`, and the cone that touches both.
export function capsule(a, b, radius, top) {
  const [from, to] = [new THREE.Vector3(...a), new THREE.Vector3(...b)];
  const along = to.clone().sub(from), length = along.length(), right = Math.PI / 2;
  if (length <= Math.abs(radius - top) + 1e-6) {
    const largest = radius > top ? from : to;
    return ellipsoid([1, 1, 1].fill(Math.max(radius, top))).translate(...largest.toArray());
  }
  const tilt = Math.asin((radius - top) / length);
  const profile = [...arc(radius, 0, 0, -right, 0), ...arc(radius, 0, 0, 0, tilt).slice(1), ...arc(top, 0, length, tilt, right)];
  const geometry = lathe(profile.filter((point, n) => n === 0 || Math.hypot(point[0] - profile[n - 1][0], point[1] - profile[n - 1][1]) > 1e-6));
  const turn = new THREE.Quaternion().setFromUnitVectors(new THREE.Vector3(0, 0, 1), along.divideScalar(length));
  return geometry.applyQuaternion(turn).translate(...a);
}

// Builds a box with rounded edges. In each side's grid, only the middle square stays flat.
export function roundedBox(size, edge) {
  const round = Math.min(edge, ...size.map((length) => length / 2));
  if (round <= 0) return new THREE.BoxGeometry(...size);
  const rings = Math.ceil(DETAIL.rings / 2), step = 0.5 / (2 * rings + 1);
  const geometry = new THREE.BoxGeometry(1, 1, 1, 2 * rings + 1, 2 * rings + 1, 2 * rings + 1);
  const position = geometry.attributes.position, normal = geometry.attributes.normal, n = new THREE.Vector3();
  for (let k = 0; k < position.count; k += 1) {
    n.fromBufferAttribute(position, k);
    const side = n.toArray().map(Math.sign);
    n.set(...n.toArray().map((x, axis) => x - side[axis] * step)).normalize();
    position.setXYZ(k, ...n.toArray().map((x, axis) => side[axis] * (size[axis] / 2 - round) + x * round));
    normal.setXYZ(k, n.x, n.y, n.z);
  }
  return geometry;
}

export function ellipsoid(radii) {
  const around = sides(Math.max(...radii));
  return new THREE.SphereGeometry(1, around, Math.ceil(around * 0.6)).rotateX(Math.PI / 2).scale(...radii);
}

// Returns the geometry of a part or of a URDF shape from the scene message.
export function solid(part) {
  switch (part.form) {
    case "box": return roundedBox(part.size, part.edge ?? 0);
    case "cone": return cone(part.radius, part.top, part.length, part.edge);
    case "cylinder": return cone(part.radius, part.radius, part.length, 0);
    case "sphere": return ellipsoid([part.radius, part.radius, part.radius]);
    case "ellipsoid": return ellipsoid(part.radii);
    case "capsule": return capsule(part.a, part.b, part.radius, part.top);
    case "lathe": return lathe(part.profile, part);
    default: throw new Error(`unknown form ${part.form}`);
  }
}

// Builds a matrix from the three upper rows of a transform.
export function matrixOf(rows) {
  return new THREE.Matrix4().set(...rows, 0, 0, 0, 1);
}

// Merges several { geometry, matrix, colour } into one geometry, with a colour for each vertex.
export function merged(pieces) {
  const count = pieces.reduce((sum, { geometry }) => sum + geometry.attributes.position.count, 0);
  const [positions, normals, colours] = [0, 1, 2].map(() => new Float32Array(3 * count));
  const index = [], colour = new THREE.Color();
  let first = 0;
  for (const piece of pieces) {
    const geometry = piece.matrix ? piece.geometry.applyMatrix4(piece.matrix) : piece.geometry;
    const vertices = geometry.attributes.position.count;
    positions.set(geometry.attributes.position.array, 3 * first);
    normals.set(geometry.attributes.normal.array, 3 * first);
    const own = geometry.attributes.color;
    colour.set(piece.colour ?? "#b8bec6");
    for (let n = 0; n < vertices; n += 1) {
      if (own) colours.set([own.getX(n), own.getY(n), own.getZ(n)], 3 * (first + n));
      else colours.set([colour.r, colour.g, colour.b], 3 * (first + n));
    }
    const order = geometry.index?.array ?? Array.from({ length: vertices }, (_, n) => n);
    // A mirror turns triangles inside out.
    const mirrors = piece.matrix && piece.matrix.determinant() < 0;
    for (let n = 0; n < order.length; n += 3) {
      index.push(first + order[n], first + order[n + (mirrors ? 2 : 1)], first + order[n + (mirrors ? 1 : 2)]);
    }
    first += vertices;
    geometry.dispose();
  }
  const all = new THREE.BufferGeometry();
  all.setAttribute("position", new THREE.BufferAttribute(positions, 3));
  all.setAttribute("normal", new THREE.BufferAttribute(normals, 3));
  all.setAttribute("color", new THREE.BufferAttribute(colours, 3));
  all.setIndex(index);
  all.computeBoundingSphere();
  all.computeBoundingBox();
  return all;
}
