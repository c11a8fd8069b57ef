// The robot: its bodies. Each is one mesh from its look, its capsules or the user's meshes. Constants without a
// source were chosen by eye: assumptions.

import * as THREE from "./three.module.min.js";
import { capsule, matrixOf, merged, solid } from "./solid.js";

// Numbers in a pose: position, then quaternion.
export const POSE = 7;
// Colours of capsules without a look, alternating by body.
const PLAIN = ["#e8ebef", "#8d98a5"];
const ROUGHNESS = 0.55;

// Returns the pieces of each body: { body, roughness, geometry, matrix, colour }. Meshes replace the parts of
// their link. Without a look, they replace the capsules of their body.
export function pieces(told, meshes) {
  if (told.parts.length > 0) {
    const drawn = new Set(meshes.map((mesh) => mesh.link));
    const parts = told.parts.filter((part) => !drawn.has(part.link) && !part.motions)
      .map((part) => ({ body: part.body, roughness: part.roughness, geometry: solid(part), matrix: matrixOf(part.matrix), colour: part.colour }));
    return [...parts, ...meshes.map(loaded)];
  }
  const drawn = new Set(meshes.map((mesh) => mesh.body));
  return [...capsulesOf(told).filter((one) => !drawn.has(one.body)), ...meshes.map(loaded)];
}

// Returns the parts of fingers that move while a hand closes. Each is a mesh of its own.
export function fingersOf(told, meshes) {
  const drawn = new Set(meshes.map((mesh) => mesh.link));
  return told.parts.filter((part) => part.motions && !drawn.has(part.link)).map((part) => ({
    body: part.body, hand: part.hand, roughness: part.roughness, outer: matrixOf(part.outer), motions: part.motions,
    geometry: merged([{ geometry: solid(part), matrix: matrixOf(part.inner), colour: part.colour }]),
  }));
}

// Returns the capsules that are checked for collision.
export function capsulesOf(told) {
  return told.capsules.map((one) => ({
    body: one.body, roughness: ROUGHNESS, geometry: capsule(one.a, one.b, one.radius, one.radius), colour: one.colour ?? PLAIN[one.body % PLAIN.length],
  }));
}

// Returns the boxes, cylinders, capsules and spheres of the URDF.
export function shapesOf(told) {
  return told.shapes.map((shape) => {
    const [x, y, z, ...turn] = shape.pose;
    const matrix = new THREE.Matrix4().makeRotationFromQuaternion(new THREE.Quaternion(...turn)).setPosition(x, y, z);
    return { body: shape.body, roughness: ROUGHNESS, geometry: solid(shape), matrix, colour: "#9fb3c8" };
  });
}

// Builds a user's mesh from the plain arrays that the page has loaded.
function loaded(mesh) {
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(mesh.positions, 3));
  geometry.setAttribute("normal", new THREE.BufferAttribute(mesh.normals, 3));
  if (mesh.colours) geometry.setAttribute("color", new THREE.BufferAttribute(mesh.colours, 3));
  return { body: mesh.body, roughness: 0.6, geometry: geometry.clone(), matrix: matrixOf(mesh.matrix), colour: mesh.colour ?? "#c9ced6" };
}

// Merges the pieces into one geometry for each body and roughness.
export function bodiesOf(all) {
  const sorted = new Map();
  for (const piece of all) {
    const key = `${piece.body} ${piece.roughness}`;
    if (!sorted.has(key)) sorted.set(key, []);
    sorted.get(key).push(piece);
  }
  return [...sorted.values()].map((same) => ({ body: same[0].body, roughness: same[0].roughness, geometry: merged(same) }));
}

export class Robot {
  // `count` is the number of bodies. `material` returns the material for a roughness. A ghost's meshes are drawn
  // twice, first only for their depth.
  constructor(bodies, fingers, count, material, depth = null) {
    this.group = new THREE.Group();
    this.bodies = Array.from({ length: count }, () => {
      const body = new THREE.Group();
      body.matrixAutoUpdate = false;
      this.group.add(body);
      return body;
    });
    this.meshes = [];
    for (const { body, roughness, geometry } of bodies) {
      const mesh = new THREE.Mesh(geometry, material(roughness));
      if (depth) {
        const before = new THREE.Mesh(geometry, depth);
        [before.renderOrder, mesh.renderOrder] = [1, 2];
        this.bodies[body].add(before);
      } else {
        [mesh.castShadow, mesh.receiveShadow] = [true, true];
      }
      this.meshes.push(mesh);
      this.bodies[body].add(mesh);
    }
    this.fingers = fingers.map(({ body, geometry, roughness, ...finger }) => {
      const mesh = new THREE.Mesh(geometry, material(roughness));
      mesh.matrixAutoUpdate = false;
      mesh.castShadow = !depth;
      mesh.renderOrder = depth ? 2 : 0;
      this.bodies[body].add(mesh);
      return { mesh, ...finger };
    });
    this.close([0, 0]);
    this.box = new THREE.Box3();
  }

  // Moves the fingers of both hands to these closures.
  close(closures) {
    for (const { mesh, hand, outer, motions } of this.fingers) {
      mesh.matrix.copy(outer);
      for (const { slide, pivot, axis, turn } of motions) {
        if (slide) {
          mesh.matrix.multiply(MOVE.makeTranslation(...slide.map((x) => x * closures[hand])));
        } else {
          mesh.matrix.multiply(MOVE.makeTranslation(...pivot));
          mesh.matrix.multiply(MOVE.makeRotationAxis(PLACE.set(...axis), turn * closures[hand]));
          mesh.matrix.multiply(MOVE.makeTranslation(...pivot.map((x) => -x)));
        }
      }
      mesh.matrixWorldNeedsUpdate = true;
    }
  }

  // `poses` are the poses of all bodies: position, then quaternion.
  pose(poses) {
    this.bodies.forEach((body, n) => {
      const at = n * POSE;
      PLACE.set(poses[at], poses[at + 1], poses[at + 2]);
      TURN.set(poses[at + 3], poses[at + 4], poses[at + 5], poses[at + 6]);
      body.matrix.compose(PLACE, TURN, ONE);
      body.matrixWorldNeedsUpdate = true;
    });
  }

  // Computes the robot's box from the boxes of its meshes.
  bound() {
    this.box.makeEmpty();
    for (const mesh of this.meshes) {
      const box = mesh.geometry.boundingBox;
      for (let n = 0; n < 8; n += 1) {
        PLACE.set(n & 1 ? box.max.x : box.min.x, n & 2 ? box.max.y : box.min.y, n & 4 ? box.max.z : box.min.z).applyMatrix4(mesh.parent.matrix);
        this.box.expandByPoint(PLACE);
      }
    }
    return this.box;
  }
}

const [PLACE, ONE] = [new THREE.Vector3(), new THREE.Vector3(1, 1, 1)], TURN = new THREE.Quaternion(), MOVE = new THREE.Matrix4();
