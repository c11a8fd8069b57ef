// The robot in the wearer's room, drawn in the page's own thread: a WebXR session lives in no worker. It shows the measured
// robot, obstacles, clearances and the sentence of the status, and no floor. Constants without a source were chosen by eye:
// assumptions.

import * as THREE from "./three.module.min.js";
import { NearLines, around } from "./near.js";
import { isHigh } from "./quality.js";
import { Robot, bodiesOf, fingersOf, pieces } from "./robot.js";
import { coarse } from "./solid.js";

// The robot stands this far ahead of the wearer, m, and looks where the wearer looks at the start. Its left is the wearer's.
const AHEAD_M = 1.5;
// Size of the text's plane, m, and of its picture, pixels.
const [WIDE_M, HIGH_M, PIXELS] = [1.0, 0.2, 1024];
// Our axes (x ahead, y left, z up) in those of WebXR (x right, y up, z back).
const AXES = new THREE.Matrix4().set(0, -1, 0, 0, 0, 0, 1, 0, -1, 0, 0, 0, 0, 0, 0, 1);

export class Room {
  // `picture` returns what is drawn. The room around is seen through where `isClear`.
  constructor(picture, isClear) {
    this.picture = picture;
    const isQuick = isHigh(null);
    if (!isQuick) coarse();
    this.renderer = new THREE.WebGLRenderer({ canvas: document.createElement("canvas"), antialias: isQuick, alpha: true });
    this.renderer.xr.enabled = true;
    this.renderer.xr.setReferenceSpaceType("local-floor");
    this.scene = new THREE.Scene();
    if (!isClear) this.scene.background = new THREE.Color(0x2b343f);
    const sun = new THREE.DirectionalLight(0xffffff, 1.9);
    sun.position.set(1.2, 5, 2.2);
    this.scene.add(new THREE.HemisphereLight(0xffffff, 0x8a93a0, 1.5), sun);
    this.camera = new THREE.PerspectiveCamera();
    this.place = new THREE.Group();
    this.place.visible = false;
    this.scene.add(this.place);
    this.base = new THREE.Group();
    this.base.matrixAutoUpdate = false;
    this.base.matrix.copy(AXES);
    this.place.add(this.base);
    [this.told, this.isPlaced, this.drawn, this.said] = [null, false, 0, ""];
    this.board();
  }

  async begin(session, each) {
    await this.renderer.xr.setSession(session);
    this.renderer.setAnimationLoop((at, frame) => { if (frame) each(at, frame); });
  }

  end() {
    this.renderer.setAnimationLoop(null);
    this.renderer.dispose();
  }

  // The plane of the text, above the robot.
  board() {
    const canvas = Object.assign(document.createElement("canvas"), { width: PIXELS, height: PIXELS * HIGH_M / WIDE_M });
    this.pen = canvas.getContext("2d");
    this.paper = new THREE.CanvasTexture(canvas);
    const plane = new THREE.Mesh(new THREE.PlaneGeometry(WIDE_M, HIGH_M), new THREE.MeshBasicMaterial({ map: this.paper, transparent: true, toneMapped: false }));
    plane.position.set(0, 1.9, 0);
    this.place.add(plane);
  }

  say(text) {
    if (text === this.said) return;
    this.said = text;
    const { pen } = this, { width, height } = pen.canvas;
    pen.clearRect(0, 0, width, height);
    pen.fillStyle = "rgb(24 30 37 / 85%)";
    pen.fillRect(0, 0, width, height);
    Object.assign(pen, { fillStyle: "#fff", font: `${height / 4.5}px sans-serif`, textAlign: "center", textBaseline: "middle" });
    const words = text.split(" "), lines = [""];
    for (const word of words) {
      const longer = `${lines.at(-1)} ${word}`.trim();
      if (pen.measureText(longer).width < 0.95 * width) lines[lines.length - 1] = longer;
      else lines.push(word);
    }
    lines.slice(0, 3).forEach((line, n, all) => pen.fillText(line, width / 2, height * (n + 1) / (all.length + 1)));
    this.paper.needsUpdate = true;
  }

  build(told, meshes) {
    this.told = told;
    this.base.clear();
    const material = new THREE.MeshLambertMaterial({ vertexColors: true });
    this.robot = new Robot(bodiesOf(pieces(told, meshes)), fingersOf(told, meshes), told.joints.length + 1, () => material);
    this.base.add(this.robot.group);
    this.near = new NearLines(0xff4050);
    this.base.add(around(told), this.near.lines);
  }

  // Places the robot ahead of the wearer, once the head is tracked.
  stand(frame) {
    const pose = frame.getViewerPose(this.renderer.xr.getReferenceSpace());
    if (!pose) return;
    const { position: p, orientation: q } = pose.transform;
    const look = new THREE.Vector3(0, 0, -1).applyQuaternion(new THREE.Quaternion(q.x, q.y, q.z, q.w)).setY(0);
    if (look.lengthSq() < 0.1) return;
    look.normalize();
    this.place.position.set(p.x + AHEAD_M * look.x, 0, p.z + AHEAD_M * look.z);
    this.place.rotation.set(0, Math.atan2(-look.x, -look.z), 0);
    [this.place.visible, this.isPlaced] = [true, true];
  }

  draw(frame) {
    const { scene: told, meshes, frame: newest, isNear, text } = this.picture();
    if (told && told !== this.told) this.build(told, meshes);
    if (!this.isPlaced) this.stand(frame);
    if (newest && this.robot) {
      this.robot.pose(newest.poses.measured);
      this.robot.close([newest.gripLeft, newest.gripRight]);
      this.near.show(newest.pair, isNear);
    }
    this.say(text);
    this.renderer.render(this.scene, this.camera);
    this.drawn += 1;
  }
}
