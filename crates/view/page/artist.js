// Draws the scene, in a thread of its own so that drawing delays no button: the person beside the robot, the robot as measured,
// and ghosts of target and command. Everything is in the robot's base frame: x forward, y left, z up, m.

import * as THREE from "./three.module.min.js";

const POSE = 7;
// The person stands beside the robot, m.
const PERSON_AT = [0, 1.5, 0];
const GHOST = 0.28;

function capsuleMesh(capsule, material) {
  const a = new THREE.Vector3(...capsule.a), b = new THREE.Vector3(...capsule.b);
  const along = b.clone().sub(a);
  const mesh = new THREE.Mesh(new THREE.CapsuleGeometry(capsule.radius, along.length(), 6, 16), material);
  mesh.position.copy(a).addScaledVector(along, 0.5);
  // three's capsules stand along y.
  if (along.length() > 0) mesh.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), along.normalize());
  return mesh;
}

function placed(mesh, pose) {
  mesh.position.set(pose[0], pose[1], pose[2]);
  mesh.quaternion.set(pose[3], pose[4], pose[5], pose[6]);
  return mesh;
}

function shapeMesh(shape, material) {
  if (shape.form === "box") return placed(new THREE.Mesh(new THREE.BoxGeometry(...shape.size), material), shape.pose);
  if (shape.form === "sphere") return placed(new THREE.Mesh(new THREE.SphereGeometry(shape.radius, 20, 14), material), shape.pose);
  const geometry = new THREE.CylinderGeometry(shape.radius, shape.radius, shape.length, 24);
  geometry.rotateX(Math.PI / 2);
  return placed(new THREE.Mesh(geometry, material), shape.pose);
}

class Artist {
  constructor(canvas) {
    this.canvas = canvas;
    this.renderer = new THREE.WebGLRenderer({ canvas, antialias: true, alpha: true });
    this.scene = new THREE.Scene();
    this.camera = new THREE.PerspectiveCamera(40, 1, 0.05, 50);
    this.camera.up.set(0, 0, 1);
    this.scene.add(new THREE.HemisphereLight(0xffffff, 0x777788, 2.2));
    const sun = new THREE.DirectionalLight(0xffffff, 1.6);
    sun.position.set(3, 2, 5);
    this.scene.add(sun);
    const grid = new THREE.GridHelper(6, 24, 0x8090a0, 0x8090a0);
    grid.rotateX(Math.PI / 2);
    grid.material.transparent = true;
    grid.material.opacity = 0.25;
    this.scene.add(grid);
    this.robots = {};
    this.colours = {};
  }

  colour(name) {
    return new THREE.Color(this.colours[name]);
  }

  build({ told, colours }) {
    this.colours = colours;
    for (const old of [...Object.values(this.robots), this.person, this.pair, this.around]) if (old) this.scene.remove(old);
    [this.capsules, this.shapes] = [[], []];
    for (const name of ["measured", "target", "command"]) {
      const ghost = name !== "measured";
      const material = new THREE.MeshStandardMaterial({
        color: this.colour(name), roughness: 0.7, transparent: ghost, opacity: ghost ? GHOST : 1, depthWrite: !ghost,
      });
      const robot = new THREE.Group();
      robot.bodies = Array.from({ length: 18 }, () => robot.add(new THREE.Group()).children.at(-1));
      const box = new THREE.MeshStandardMaterial({
        color: this.colour(name), roughness: 0.8, transparent: true, opacity: 0.2, depthWrite: false,
      });
      for (const shape of told.shapes) {
        const mesh = shapeMesh(shape, box);
        this.shapes.push(mesh);
        robot.bodies[shape.body].add(mesh);
      }
      for (const capsule of told.capsules) {
        const mesh = capsuleMesh(capsule, material);
        this.capsules.push(mesh);
        robot.bodies[capsule.body].add(mesh);
      }
      this.robots[name] = robot;
      this.scene.add(robot);
    }
    this.parents = told.person.parents;
    this.person = new THREE.Group();
    this.person.position.set(...PERSON_AT);
    const skin = new THREE.MeshStandardMaterial({ color: this.colour("person"), roughness: 0.6 });
    this.bones = this.parents.map(() => new THREE.Mesh(new THREE.CylinderGeometry(0.022, 0.022, 1, 10), skin));
    this.balls = this.parents.map((_, n) => new THREE.Mesh(new THREE.SphereGeometry(n === 15 ? 0.09 : 0.03, 14, 10), skin));
    this.person.add(...this.bones, ...this.balls);
    this.scene.add(this.person);
    this.pair = new THREE.Line(new THREE.BufferGeometry().setAttribute("position", new THREE.BufferAttribute(new Float32Array(6), 3)),
      new THREE.LineBasicMaterial({ color: this.colour("bad"), depthTest: false }));
    this.pair.frustumCulled = false;
    this.scene.add(this.pair);
    this.around = new THREE.Group();
    const wall = new THREE.MeshStandardMaterial({ color: 0x8090a0, transparent: true, opacity: 0.3 });
    for (const obstacle of told.obstacles) if (obstacle.form === "box") this.around.add(shapeMesh(obstacle, wall));
    this.scene.add(this.around);
  }

  parts({ capsules, shapes }) {
    for (const mesh of this.capsules ?? []) mesh.visible = capsules;
    for (const mesh of this.shapes ?? []) mesh.visible = shapes;
  }

  // `shown` says which layers are; `frame` is one of the wire's.
  update({ frame, shown }) {
    if (!this.person) return;
    for (const [name, robot] of Object.entries(this.robots)) {
      robot.visible = shown[name];
      const poses = frame.poses[name];
      robot.bodies.forEach((body, n) => placed(body, poses.subarray(n * POSE, (n + 1) * POSE)));
    }
    this.person.visible = shown.person;
    const joint = (n) => new THREE.Vector3(...frame.person.subarray(3 * n, 3 * n + 3));
    const floor = Math.min(...this.parents.map((_, n) => frame.person[3 * n + 2]));
    this.person.position.z = -floor;
    this.parents.forEach((parent, n) => {
      const [to, from] = [joint(n), joint(parent)];
      const along = to.clone().sub(from), length = along.length();
      this.balls[n].position.copy(to);
      this.bones[n].visible = n > 0 && length > 1e-4;
      if (!this.bones[n].visible) return;
      this.bones[n].position.copy(from).addScaledVector(along, 0.5);
      this.bones[n].scale.y = length;
      this.bones[n].quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), along.normalize());
    });
    this.pair.visible = shown.pair;
    this.pair.geometry.attributes.position.array.set(frame.pair);
    this.pair.geometry.attributes.position.needsUpdate = true;
  }

  resize({ width, height, scale }) {
    this.renderer.setPixelRatio(scale);
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / Math.max(height, 1);
    this.camera.updateProjectionMatrix();
  }

  look({ yaw, pitch, distance, at }) {
    const flat = Math.cos(pitch) * distance;
    this.camera.position.set(at[0] + Math.cos(yaw) * flat, at[1] + Math.sin(yaw) * flat, at[2] + Math.sin(pitch) * distance);
    this.camera.lookAt(...at);
  }

  draw() {
    this.renderer.render(this.scene, this.camera);
  }
}

let artist = null, drawn = 0, newest = null;

function draw() {
  // Of frames that came while another was drawn the newest is enough.
  if (newest) artist.update(newest);
  newest = null;
  artist.draw();
  drawn += 1;
  postMessage({ drawn });
  requestAnimationFrame(draw);
}

onmessage = ({ data }) => {
  try {
    if (data.do === "canvas") {
      artist = new Artist(data.canvas);
      requestAnimationFrame(draw);
    } else if (data.do === "update") {
      newest = data;
    } else {
      artist?.[data.do](data);
    }
  } catch (error) {
    postMessage({ trouble: error.message });
  }
};
