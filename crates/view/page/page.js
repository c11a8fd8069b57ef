// What the page shows and asks. It can only ask: control decides.

import { Stage } from "./stage.js";
import { Chart } from "./chart.js";
import { Mix } from "./mix.js";
import { PRESENT, Wire } from "./wire.js";

const $ = (id) => document.getElementById(id);
// While the enable is held, this is said so often, ms; the server lets go after 500.
const KEEP = 100;
// A joint this near to a limit is marked, as a share of its range.
const NEAR = 0.03;
const EVENTS_KEPT = 1000;

const charts = Object.fromEntries([["age", 20], ["late", 200], ["limb", 10], ["clearance", 50]]
  .map(([name, least]) => [name, new Chart(document.querySelector(`[data-chart=${name}]`), least)]));
let stage = null, scene = null, frame = null, joints = [], held = false, drawn = 0, keeping = null;
// Of a recording: whether it plays, whether it is at its end, and whether the slider is being held.
let playing = true, ended = false, sliding = false;

function text(id, value) {
  if ($(id).textContent !== value) $(id).textContent = value;
}

function hold(now) {
  held = now;
  $("engage").setAttribute("aria-pressed", String(now));
  clearInterval(keeping);
  if (now) keeping = setInterval(() => wire.ask("keep"), KEEP);
}

function ask(what) {
  if (!wire.ask(what)) text("answer", "Not connected: this was not asked. The emergency stop of the robot still works.");
}

function isRecording() {
  return scene?.about.source === "recording";
}

function showPlaying(now) {
  playing = now;
  $("play").setAttribute("aria-pressed", String(now));
  text("play", now ? "Pause" : "Play");
}

function play(now) {
  showPlaying(now);
  wire.ask(now ? "play" : "pause");
}

function showParts() {
  stage?.parts($("show-capsules").checked, $("show-shapes").checked);
}

function engage() {
  text("answer", "");
  ask("engage");
}

const told = {
  up() {
    $("link").classList.remove("bad");
    text("link", "connected");
  },
  down(opened) {
    hold(false);
    mix.told({ on: false });
    frame = null;
    $("link").classList.add("bad");
    text("link", opened || scene ? "connection lost; has the run ended? Trying again" : "no connection: is the address the one with the token, and does it still run?");
    setMode("not connected");
  },
  scene(message) {
    scene = message;
    stage?.build(message);
    showParts();
    $("joints").replaceChildren(...message.joints.map((joint) => {
      const row = document.createElement("div");
      row.className = "joint";
      const name = document.createElement("span"), bar = document.createElement("div"), value = document.createElement("output");
      name.textContent = joint.name;
      bar.className = "bar";
      bar.append(document.createElement("i"), document.createElement("i"));
      bar.children[0].className = "target";
      row.append(name, bar, value);
      return row;
    }));
    joints = [...$("joints").children];
    $("events").replaceChildren();
    const recorded = message.about.source === "recording";
    $("hand").hidden = recorded;
    $("reel").hidden = !recorded;
    mix.build(message.about.key_poses);
    if (recorded) {
      text("name", message.about.name);
      $("at").max = message.about.duration_s;
    }
  },
  status({ status }) {
    text("why", status ? status.why : "control is not heard.");
    const faults = status?.faults ?? [];
    $("faults").replaceChildren(...faults.map((fault) => Object.assign(document.createElement("li"), { textContent: fault })));
    if (status) text("link", `${status.realtime ? "real-time" : "no real-time"}, ${status.missed_deadlines} of ${status.ticks} deadlines missed; calibration: ${status.calibration}`);
  },
  event({ at_s, gravity, text: sentence }) {
    const row = document.createElement("li"), at = document.createElement("time");
    at.textContent = `${at_s.toFixed(1)} s`;
    row.className = gravity;
    row.dataset.at = at_s;
    row.append(at, sentence);
    $("events").prepend(row);
    while ($("events").children.length > EVENTS_KEPT) $("events").lastChild.remove();
  },
  hand(message) {
    hold(message.held);
    text("answer", message.text ?? "");
  },
  mix(message) {
    mix.told(message);
  },
  frame(message) {
    frame = message;
    const has = (bit) => (message.present & bit) !== 0;
    const status = has(PRESENT.command);
    charts.age.add(status && message.age > 0 ? message.age : null);
    charts.late.add(status ? message.late : null);
    charts.limb.add(status ? message.limbMeasured : null);
    charts.clearance.add(status ? message.clearance : null);
  },
};

function setMode(name) {
  text("mode", name);
  $("mode").dataset.mode = name;
}

function show() {
  const has = (bit) => (frame.present & bit) !== 0;
  const heard = has(PRESENT.command);
  setMode(heard ? scene.modes[frame.mode] ?? "unknown" : isRecording() ? "nothing recorded" : "no instance");
  if (isRecording()) {
    if (!sliding) $("at").value = frame.at;
    // It stands by itself when it comes to its end; frames from there may still come when it is played anew. The numbers
    // of a frame are of single precision.
    const over = frame.at >= Math.fround(scene.about.duration_s);
    if (over && !ended) showPlaying(false);
    ended = over;
    text("time", `${frame.at.toFixed(2)} of ${scene.about.duration_s.toFixed(2)} s`);
    // Sentences of what is yet to come are dim.
    for (const row of $("events").children) row.classList.toggle("later", Number(row.dataset.at) > frame.at + 0.01);
  }
  const figure = (id, value, unit, digits) => text(id, heard ? `${value.toFixed(digits)} ${unit}` : "–");
  figure("age", frame.age, "ms", 1);
  figure("late", frame.late, "µs", 0);
  figure("limb", frame.limbMeasured, "°", 1);
  figure("clearance", frame.clearance, "mm", 0);
  const part = (n) => scene.capsules[n]?.name ?? scene.obstacles[n - scene.capsules.length]?.name ?? "?";
  text("pair", heard ? `nearest: ${part(frame.pairA)} and ${part(frame.pairB)}, ${frame.clearance.toFixed(0)} mm` : "");
  joints.forEach((row, j) => {
    const { q_min, q_max, unit } = scene.joints[j];
    const share = (q) => (q - q_min) / (q_max - q_min);
    const at = share(frame.q.measured[j]);
    const [target, measured] = row.children[1].children;
    measured.style.left = `${100 * Math.min(1, Math.max(0, at))}%`;
    target.style.left = `${100 * Math.min(1, Math.max(0, share(frame.q.target[j])))}%`;
    target.hidden = !has(PRESENT.target) || (frame.targetMask >> j & 1) === 0;
    row.classList.toggle("near", at < NEAR || at > 1 - NEAR);
    const value = `${frame.q.measured[j].toFixed(3)} ${unit}`;
    if (row.children[2].textContent !== value) row.children[2].textContent = value;
  });
  stage?.update(frame, {
    person: has(PRESENT.person) && $("show-person").checked,
    measured: has(PRESENT.measured) && $("show-measured").checked,
    target: has(PRESENT.target) && $("show-target").checked,
    command: heard && $("show-command").checked,
    pair: has(PRESENT.pair),
  });
}

function draw(at) {
  requestAnimationFrame(draw);
  if (frame && scene) show();
  // Charts and texts are for the eye: ten times a second.
  if (at - drawn > 100) {
    drawn = at;
    for (const chart of Object.values(charts)) chart.draw();
  }
}

$("stop").addEventListener("click", () => ask("stop"));
$("engage").addEventListener("click", () => (held ? ask("release") : engage()));
$("release").addEventListener("click", () => ask("release"));
$("reset").addEventListener("click", () => { text("answer", ""); ask("reset"); });
$("play").addEventListener("click", () => play(!playing));
$("at").addEventListener("pointerdown", () => { sliding = true; });
for (const end of ["pointerup", "pointercancel"]) $("at").addEventListener(end, () => { sliding = false; });
$("at").addEventListener("input", () => wire.ask("seek", { to_s: Number($("at").value) }));
for (const id of ["show-capsules", "show-shapes"]) $(id).addEventListener("change", showParts);
// Before any button: Space on a focused button would press that instead.
document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.altKey || event.metaKey) return;
  if (isRecording()) {
    if (event.code === "Space") {
      event.preventDefault();
      if (!event.repeat) play(!playing);
    }
  } else if (event.code === "Space") {
    event.preventDefault();
    if (!event.repeat) ask("stop");
  } else if (event.key === "e" && !event.repeat && !held) {
    engage();
  } else if (event.key === "r" && !event.repeat) {
    ask("release");
  }
}, true);
document.addEventListener("keyup", (event) => { if (event.code === "Space") event.preventDefault(); }, true);
// Nobody looks at a page behind another: it lets go.
document.addEventListener("visibilitychange", () => {
  if (document.hidden && held) ask("release");
  if (document.hidden && mix.on) mix.lead(false);
});

try {
  stage = new Stage($("stage"), (why) => text("trouble", `no picture: ${why}`));
} catch (error) {
  text("trouble", `no picture: ${error.message}`);
}
const mix = new Mix((what, more) => wire.ask(what, more), $);
const wire = new Wire(location.hash.slice(1), told);
// Light and dark have colours of their own.
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
  if (scene) stage?.build(scene);
  showParts();
});
requestAnimationFrame(draw);
// For tests: what is shown, as numbers.
window.teleopd = { frame: () => frame, drawn: () => stage?.drawn ?? 0 };
