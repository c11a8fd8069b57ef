// Draws the scene in its own thread, so that drawing delays no button. It shows the person, the measured robot,
// and ghosts of target and command. Everything is in the robot's base frame: x forward, y left, z up, m.
// Constants without a source were chosen by eye: assumptions.

import * as THREE from "./three.module.min.js";
import { CameraRig } from "./camera.js";
import { Floor } from "./floor.js";
import { NearLines, around } from "./near.js";
import { Person } from "./person.js";
import { POSE, Robot, bodiesOf, capsulesOf, fingersOf, pieces, shapesOf } from "./robot.js";
import { isHigh, Sharpness } from "./quality.js";
import { coarse } from "./solid.js";

// Distance of the person from the robot's stretched hand, m: to the robot's left, or behind it in the view from the
// left. In a narrow window they stand closer.
const BESIDE = { wide: 0.35, narrow: 0.1, side: 0 };
const GHOST = 0.42;
// Ghosts are pushed back by about 5 mm. A ghost that coincides with the robot is therefore hidden.
const BEHIND = { polygonOffset: true, polygonOffsetFactor: 3, polygonOffsetUnits: 150 };
// Fade time of a ghost, s.
const FADE_S = 0.2;
// Frames further apart than this are not consecutive, s.
const JUMP_S = 1;
// Number of capsules per body that cast a shadow.
const CASTING = 2;
const LAYERS = ["measured", "target", "command"];

class Artist {
  constructor({ canvas, quality }) {
    this.isHigh = isHigh(quality);
    this.sharpness = new Sharpness(this.isHigh);
    if (!this.isHigh) coarse();
    this.renderer = new THREE.WebGLRenderer({ canvas, antialias: this.isHigh, alpha: true, powerPreference: "high-performance" });
    this.renderer.shadowMap.enabled = this.isHigh;
    this.renderer.shadowMap.type = THREE.VSMShadowMap;
    this.renderer.localClippingEnabled = true;
    this.scene = new THREE.Scene();
    this.rig = new CameraRig();
    this.floor = new Floor(this.scene, this.isHigh);
    this.materials = new Map();
    this.ghosts = {};
    [this.robots, this.meshes, this.told, this.newest] = [{}, [], null, null];
    [this.placing, this.kind, this.isDirty] = ["beside", "look", true];
    this.view = "reset";
    [this.root, this.boxes] = [new THREE.Vector3(), { person: [0, 0, 0, 0], robot: [0, 0, 0, 0] }];
    this.drawn = 0;
  }

  material(roughness) {
    if (!this.isHigh) return this.dull ??= new THREE.MeshLambertMaterial({ vertexColors: true });
    if (!this.materials.has(roughness)) this.materials.set(roughness, new THREE.MeshStandardMaterial({ vertexColors: true, roughness }));
    return this.materials.get(roughness);
  }

  build({ told, colours }) {
    [this.told, this.colours] = [told, colours];
    this.floor.paint(colours.grid, Number(colours.shadow));
    if (this.person) {
      this.scene.remove(this.person.group);
      this.person.dispose();
    }
    this.person = new Person(colours.person, this.isHigh);
    this.person.overlay(this.placing === "overlaid");
    this.scene.add(this.person.group);
    if (this.near) this.scene.remove(this.near.lines, this.around);
    [this.near, this.around] = [new NearLines(colours.bad), around(told)];
    this.scene.add(this.near.lines, this.around);
    this.casting = casting(told.capsules);
    this.standing = standing(told.capsules.filter((one) => one.body === 0));
    this.buildRobots();
  }

  // `kind` is look, capsules or shapes.
  buildRobots() {
    for (const robot of Object.values(this.robots)) {
      this.scene.remove(robot.group);
      robot.group.traverse((mesh) => mesh.geometry?.dispose());
    }
    const { told, kind, meshes } = this;
    const bodies = bodiesOf(kind === "look" ? pieces(told, meshes) : kind === "capsules" ? capsulesOf(told) : shapesOf(told));
    const fingers = kind === "look" ? fingersOf(told, meshes) : [], count = told.joints.length + 1;
    this.robots = { measured: new Robot(bodies, fingers, count, (roughness) => this.material(roughness)) };
    for (const name of ["target", "command"]) {
      const colour = new THREE.MeshLambertMaterial({ color: this.colours[name], emissive: this.colours[name], emissiveIntensity: 0.3, transparent: true, opacity: 0, depthWrite: false, ...BEHIND });
      const depth = new THREE.MeshBasicMaterial({ colorWrite: false, ...BEHIND });
      this.robots[name] = new Robot(bodies, fingers, count, () => colour, depth);
      this.ghosts[name] = { material: colour, wished: this.ghosts[name]?.wished ?? 0 };
    }
    for (const robot of Object.values(this.robots)) this.scene.add(robot.group);
    this.isDirty = true;
  }

  parts({ kind }) {
    if (kind === this.kind) return;
    this.kind = kind;
    if (this.told) this.buildRobots();
  }

  load({ meshes }) {
    this.meshes = meshes;
    if (this.told) this.buildRobots();
  }

  // `shown` tells which layers are visible. `frame` is a frame of the wire.
  update(newest) {
    // A recording was moved to another time. The figures and the camera jump.
    if (Math.abs(newest.frame.at - (this.newest?.frame.at ?? 0)) > JUMP_S) {
      this.person?.forget();
      this.rig.isSettled = false;
    }
    this.newest = newest;
    this.isDirty = true;
  }

  place({ placing }) {
    this.placing = placing;
    this.person?.overlay(placing === "overlaid");
    this.rig.isSettled = false;
    this.isDirty = true;
  }

  resize({ width, height, scale, inset }) {
    this.scale = scale;
    this.sharpen();
    this.renderer.setSize(width, height, false);
    this.rig.resize(width, height, inset);
    this.isDirty = true;
  }

  turn({ dx, dy }) { this.rig.turn(dx, dy); this.isDirty = true; }
  move({ dx, dy }) { this.rig.move(dx, dy); this.isDirty = true; }
  zoom({ factor }) { this.rig.zoom(factor); this.isDirty = true; }
  look({ view }) { this.view = view; this.rig.view(view); this.isDirty = true; }

  pose(dt) {
    const { frame, shown } = this.newest;
    for (const name of LAYERS) {
      const robot = this.robots[name];
      if (name === "measured") robot.group.visible = shown.measured;
      else this.fade(robot, this.ghosts[name], shown[name], dt);
      if (!robot.group.visible) continue;
      robot.pose(frame.poses[name]);
      robot.close([frame.gripLeft, frame.gripRight]);
    }
    this.person.group.visible = shown.person;
    const root = this.rootOf(frame);
    if (shown.person) this.person.update(frame.person, frame.turns, this.placing, root, dt);
    this.near.show(frame.pair, shown.pair);
  }

  rootOf(frame) {
    const reach = this.told.half_span;
    if (this.placing === "beside" && this.view === "side") return this.root.set(-reach - BESIDE.side, 0, 0);
    if (this.placing !== "overlaid") return this.root.set(0, reach + (this.rig.camera.aspect < 1 ? BESIDE.narrow : BESIDE.wide), 0);
    const [a, b] = this.told.shoulders.map((body) => body * POSE), poses = frame.poses.measured;
    return this.root.set((poses[a] + poses[b]) / 2, (poses[a + 1] + poses[b + 1]) / 2, (poses[a + 2] + poses[b + 2]) / 2);
  }

  fade(robot, ghost, isShown, dt) {
    const to = isShown ? GHOST : 0, now = ghost.material.opacity;
    ghost.material.opacity = Math.abs(to - now) < 0.01 ? to : now + (to - now) * (1 - Math.exp(-dt / FADE_S));
    robot.group.visible = ghost.material.opacity > 0;
    if (ghost.material.opacity !== to) this.isDirty = true;
  }

  // Records the time between two pictures of a moving scene, s. It equals the drawing time of a picture.
  took(dt) {
    if (!this.sharpness.note(dt)) return;
    this.sharpen();
    // Another number of pixels empties the picture.
    this.isDirty = true;
  }

  sharpen() { this.renderer.setPixelRatio(this.scale * this.sharpness.share); }

  draw(dt) {
    this.isDirty = false;
    if (this.newest && this.person) {
      this.pose(dt);
      this.frame(dt);
    }
    this.renderer.render(this.scene, this.rig.camera);
    this.drawn += 1;
  }

  frame(dt) {
    const { rig, boxes } = this, { shown } = this.newest;
    const robot = this.robots.measured.bound();
    rig.begin();
    if (shown.measured || !shown.person) rig.see(0, robot, dt);
    if (shown.person) rig.see(1, this.person.box, dt);
    rig.follow(dt, this.placing === "world");
    // The floor stays still under figures that stand still.
    if (this.placing === "world") this.floor.follow(rig.middle.x, rig.middle.y);
    else this.floor.follow(this.placing === "beside" ? this.root.x / 2 : 0, this.placing === "beside" ? this.root.y / 2 : 0);
    project(robot, rig.camera, boxes.robot);
    project(this.person.box, rig.camera, boxes.person);
    if (this.floor.limbs) this.shade(this.floor.limbs);
    if (!rig.isStill) this.isDirty = true;
  }

  // Draws the shadows of the visible figures. The robot's capsules represent its shapes.
  shade(limbs) {
    const { shown } = this.newest;
    limbs.begin();
    if (shown.measured) {
      const { x, y, radius } = this.standing;
      limbs.add(x, y, 0.05, x, y, 0.05, radius);
      for (const { body, a, b, radius } of this.casting) {
        const { matrix } = this.robots.measured.bodies[body];
        FROM.set(...a).applyMatrix4(matrix);
        TO.set(...b).applyMatrix4(matrix);
        limbs.add(FROM.x, FROM.y, FROM.z, TO.x, TO.y, TO.z, radius);
      }
    }
    if (shown.person) this.person.shade(limbs);
    limbs.end();
  }
}

// Returns the capsules that cast shadows: the largest of each body. The base has its disc instead.
function casting(capsules) {
  const size = ({ a, b, radius }) => radius * (Math.hypot(...a.map((x, axis) => x - b[axis])) + radius);
  const sorted = capsules.filter((one) => one.body !== 0).sort((one, other) => size(other) - size(one));
  return sorted.filter((one, n) => sorted.slice(0, n).filter((larger) => larger.body === one.body).length < CASTING);
}

// Returns the disc on the floor under a base.
function standing(capsules) {
  const ends = capsules.flatMap(({ a, b, radius }) => [[...a, radius], [...b, radius]]);
  const [x, y] = [0, 1].map((axis) => (Math.min(...ends.map((end) => end[axis])) + Math.max(...ends.map((end) => end[axis]))) / 2);
  return { x, y, radius: ends.length === 0 ? 0.01 : Math.max(...ends.map((end) => Math.hypot(end[0] - x, end[1] - y) + end[3])) };
}

// Projects a box into the view: left, bottom, right, top. Values from -1 to 1 are inside.
function project(box, camera, out) {
  [out[0], out[1], out[2], out[3]] = [Infinity, Infinity, -Infinity, -Infinity];
  for (let n = 0; n < 8; n += 1) {
    CORNER.set(n & 1 ? box.max.x : box.min.x, n & 2 ? box.max.y : box.min.y, n & 4 ? box.max.z : box.min.z).project(camera);
    out[0] = Math.min(out[0], CORNER.x);
    out[1] = Math.min(out[1], CORNER.y);
    out[2] = Math.max(out[2], CORNER.x);
    out[3] = Math.max(out[3], CORNER.y);
  }
}

const [CORNER, FROM, TO] = [0, 1, 2].map(() => new THREE.Vector3());
let artist = null, before = 0, asked = null;

function draw(now) {
  requestAnimationFrame(draw);
  const dt = Math.min(0.25, (now - before) / 1000);
  // The browser requests the next picture once the last one is done.
  if (asked !== null) artist.took((now - asked) / 1000);
  asked = artist.isDirty ? now : null;
  if (!artist.isDirty) return;
  before = now;
  artist.draw(dt);
  postMessage({ drawn: artist.drawn, boxes: artist.boxes, ghost: artist.ghosts.target?.material.opacity ?? 0, share: artist.sharpness.share });
}

onmessage = ({ data }) => {
  try {
    if (data.do === "canvas") {
      artist = new Artist(data);
      requestAnimationFrame(draw);
    } else {
      artist?.[data.do](data);
    }
  } catch (error) {
    postMessage({ trouble: error.message });
  }
};
