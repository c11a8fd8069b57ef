// The panel of numbers: figures with their sparklines, joints against their limits, and events.

import { Sparkline } from "./sparkline.js";
import { PRESENT } from "./wire.js";

// A joint closer to a limit than this share of its range is marked.
const NEAR = 0.03;
const EVENTS_KEPT = 1000;
// Time between two updates of the numbers, ms. They are for the eye.
const EVERY_MS = 100;

export class Panel {
  // `$` finds an element.
  constructor($) {
    Object.assign(this, { $, scene: null, rows: [], shownAt: 0, lag: null, lost: 0, events: 0 });
    const line = (name, least) => new Sparkline(document.querySelector(`[data-line=${name}]`), { least });
    this.lines = { behind: line("behind", 10), delay: line("delay", 200), clearance: line("clearance", 100) };
  }

  text(id, value) {
    const element = this.$(id);
    if (element.textContent !== value) element.textContent = value;
  }

  build(scene) {
    this.scene = scene;
    this.lag = null;
    const { limits } = scene;
    for (const [name, limit] of [["behind", limits.behind_deg], ["delay", limits.delays_ms[0]], ["clearance", limits.clearance_mm]]) {
      this.lines[name].clear();
      this.lines[name].limit = limit;
    }
    this.rows = scene.joints.map((joint) => jointRow(joint));
    this.$("joints").replaceChildren(...this.rows.map((row) => row.element));
    this.$("events").replaceChildren();
    this.events = 0;
    this.text("count", "");
  }

  // Records a frame. The delay from the person to the robot is the delay by the settings plus the robot's lag.
  take(frame) {
    const heard = (frame.present & PRESENT.command) !== 0;
    if ((frame.present & PRESENT.lag) !== 0) this.lag = frame.lag;
    if (!heard) this.lag = null;
    const delay = this.scene.limits.delays_ms[(frame.present & PRESENT.oneCamera) === 0 ? 0 : 1];
    frame.delay = this.lag === null ? null : delay + this.lag;
    const person = heard && (frame.present & PRESENT.person) !== 0;
    this.lines.behind.add(frame.at, person ? frame.limbMeasured : null);
    this.lines.delay.add(frame.at, person ? frame.delay : null);
    this.lines.clearance.add(frame.at, heard ? frame.clearance : null);
  }

  show(frame, now) {
    if (now - this.shownAt < EVERY_MS) return;
    this.shownAt = now;
    const heard = (frame.present & PRESENT.command) !== 0, person = heard && (frame.present & PRESENT.person) !== 0;
    const figure = (id, value, unit, digits, known = heard) => this.text(id, known && value !== null ? `${value.toFixed(digits)}${unit}` : "–");
    // The sentence above reads the same status, so both show the same number.
    figure("behind", this.behind, "°", 0, person);
    figure("delay", frame.delay, " ms", 0, person);
    figure("clearance", frame.clearance, " mm", 0);
    figure("age", frame.age, this.lost > 0 ? ` ms, ${this.lost.toFixed(1)} % lost` : " ms", 1, heard && frame.age > 0);
    figure("late", frame.late, " µs", 0);
    figure("limb-target", frame.limbTarget, "°", 1, person);
    figure("speed", 100 * frame.speed, " %", 0);
    const measured = (frame.present & PRESENT.measured) !== 0, { grippers } = this.scene;
    [["grip-left", frame.gripLeft, frame.forceLeft], ["grip-right", frame.gripRight, frame.forceRight]].forEach(([id, grip, force], hand) => {
      figure(id, 100 * grip, force > 0 ? ` %, ${force.toFixed(0)} N` : " %", 0, measured && grippers[hand]);
    });
    const part = (n) => this.scene.capsules[n]?.name ?? this.scene.obstacles[n - this.scene.capsules.length]?.name ?? "?";
    this.text("pair", heard ? `${part(frame.pairA)}, ${part(frame.pairB)}` : "");
    this.redraw();
    if (this.$("joint-bars").open) this.rows.forEach((row, j) => showJoint(row, this.scene.joints[j], frame, j));
  }

  // Nothing arrives, so the old numbers disappear.
  silent() {
    for (const id of ["behind", "delay", "clearance", "age", "late", "limb-target", "speed", "grip-left", "grip-right"]) this.text(id, "–");
    this.text("pair", "");
    this.status(null);
  }

  // Redraws with the current colours.
  redraw() {
    for (const line of Object.values(this.lines)) line.draw();
  }

  status(status) {
    this.lost = status?.lost_percent ?? 0;
    this.behind = status?.limb_error_measured_deg ?? null;
    const limited = status?.limited;
    const why = { speed: "at its highest speed", clearance: "as close as they may be", range: "at the end of its range" }[limited?.by];
    this.text("limit", why ? `${limited.about ?? ""} ${why}`.trim() : "");
    this.text("realtime", status ? (status.realtime ? "yes" : "no") : "–");
    this.text("missed", status ? `${status.missed_deadlines} of ${status.ticks}` : "–");
    this.text("calibration", status ? status.calibration : "–");
  }

  event({ at_s, gravity, text: sentence }) {
    const row = document.createElement("li"), at = document.createElement("time");
    at.textContent = `${at_s.toFixed(1)} s`;
    row.className = gravity;
    row.dataset.at = at_s;
    row.append(at, sentence);
    const events = this.$("events");
    events.prepend(row);
    while (events.children.length > EVENTS_KEPT) events.lastChild.remove();
    this.events += 1;
    this.text("count", `${this.events}`);
    // The list is folded, so screen readers read new events from here.
    this.text("news", sentence);
  }

  // In a recording, dims the events that are still to come.
  later(at) {
    for (const row of this.$("events").children) row.classList.toggle("later", Number(row.dataset.at) > at + 0.01);
  }
}

function jointRow(joint) {
  const element = document.createElement("div");
  element.className = "joint";
  const [name, bar, value] = ["span", "div", "output"].map((tag) => document.createElement(tag));
  name.textContent = joint.name;
  bar.className = "bar";
  const [target, measured] = [document.createElement("i"), document.createElement("i")];
  target.className = "target";
  bar.append(target, measured);
  element.append(name, bar, value);
  return { element, target, measured, value };
}

function showJoint(row, { q_min, q_max, unit }, frame, j) {
  const share = (q) => (q - q_min) / (q_max - q_min), percent = (x) => `${100 * Math.min(1, Math.max(0, x))}%`;
  const at = share(frame.q.measured[j]);
  row.measured.style.left = percent(at);
  row.target.style.left = percent(share(frame.q.target[j]));
  row.target.hidden = (frame.present & PRESENT.target) === 0 || (frame.targetMask >> j & 1) === 0;
  row.element.classList.toggle("near", at < NEAR || at > 1 - NEAR);
  const text = `${frame.q.measured[j].toFixed(3)} ${unit}`;
  if (row.value.textContent !== text) row.value.textContent = text;
}
