// Content and requests of the page. It can only send requests, and control decides.

import { Stage } from "./stage.js";
import { Panel } from "./panel.js";
import { Mix } from "./mix.js";
import { PRESENT, Wire, isSame } from "./wire.js";

const $ = (id) => document.getElementById(id);
// Period of the repeated request while the enable is held, ms. The server releases it after 500 ms.
const KEEP = 100;
// The target's ghost appears above the limit. It disappears below this share of it.
const GONE = 0.6;

const panel = new Panel($);
let webcam = null, headset = null, meshesDrawn = [], stage = null, broken = null, meshesAre = null, scene = null, frame = null, held = false, clutched = false, keeping = null, isBehind = false, isNew = false;
// State last sent to the artist.
let drawnFrame = null, drawnLayers = "";
// State of a recording: whether it plays, whether it is at its end, and whether the user holds the slider.
let playing = true, ended = false, sliding = false;

const text = (id, value) => panel.text(id, value);

function hold(now) {
  held = now;
  $("engage").setAttribute("aria-pressed", String(now));
  text("engage-key", now ? "E releases" : "E");
  if (!now) clutched = false;
  keep();
}

// Repeats that the enable or the clutch is held.
function keep() {
  $("clutch").setAttribute("aria-pressed", String(clutched !== false));
  clearInterval(keeping);
  if (held || clutched !== false) keeping = setInterval(() => wire.ask("keep"), KEEP);
}

// Holds the clutch, or lets go of it: the robot stands while the person moves freely. Only the key or the pointer that
// holds it lets go of it.
function clutch(by) {
  if (clutched !== false || !ask("clutch", { held: true })) return;
  clutched = by;
  keep();
}

function declutch(by) {
  if (clutched !== by) return;
  clutched = false;
  ask("clutch", { held: false });
  keep();
}

function ask(what, more) {
  const sent = wire.ask(what, more);
  if (!sent) text("answer", "Not connected: the request was not sent. The robot's own emergency stop still works.");
  return sent;
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

function engage() {
  text("answer", "");
  const arm = $("arms").value;
  ask("engage", arm === "both" ? undefined : { arm });
}

// Covers the scene while there is nothing to see. Empty texts uncover it.
function curtain(title, more = "") {
  if (broken !== null) [title, more] = ["No picture", broken];
  $("curtain").hidden = title === "";
  text("curtain-title", title);
  text("curtain-text", more);
}

function setMode(name) {
  text("mode", name);
  $("mode").dataset.mode = name;
}

// Loads the user's own meshes, once for each set.
async function loadMeshes({ meshes, missing_meshes: missing }) {
  const key = JSON.stringify(meshes);
  if (!stage || key === meshesAre || (meshes.length === 0 && meshesAre === null)) return;
  meshesAre = key;
  const { MeshLoader } = await import("./meshes.js");
  const { drawn, failed } = await new MeshLoader(location.hash.slice(1)).load(meshes, (done, all) => text("meshes", `loading ${done + 1} of ${all}`));
  const not = [...failed, ...missing.map((name) => `${name}: not found`)];
  text("meshes", `${drawn.length} drawn${not.length > 0 ? `, not ${not.join("; ")}` : ""}`);
  meshesDrawn = drawn;
  stage.tell("load", { meshes: drawn });
}

// Shows the camera's panel, if the server allows a camera.
async function showCamera({ camera }) {
  $("cam").hidden = !camera;
  if (!camera || webcam) return;
  const { Webcam } = await import("./webcam.js");
  webcam ??= new Webcam(wire, $, `/vision/${location.hash.slice(1)}`);
}

// What a headset draws.
function picture() {
  const isNear = frame !== null && (frame.present & PRESENT.pair) !== 0;
  return { scene, meshes: meshesDrawn, frame, isNear, text: `${$("mode").textContent}. ${$("why").textContent}` };
}

// Shows the headset's panel, if this browser has a headset and the page shows an instance. Otherwise says why not.
async function showHeadset() {
  if (headset || isRecording()) return;
  if (!navigator.xr) return text("xr-none", isSecureContext ? "This browser has no WebXR, so no headset." : "A headset needs https or localhost: see --https.");
  const { Headset, offered } = await import("./headset.js");
  const mode = await offered();
  $("xr").hidden = mode === null;
  text("xr-none", mode === null ? "This browser has WebXR, but finds no headset." : "");
  if (mode !== null) headset ??= new Headset(wire, $, mode, picture);
}

const told = {
  up() {
    $("link").classList.remove("bad");
    text("link", "connected");
  },
  down(opened) {
    hold(false);
    mix.told({ on: false });
    webcam?.stop("The connection was lost, so the camera is off.");
    webcam?.calibration({ on: false, written: false });
    headset?.stop("The connection was lost, so the headset is off.");
    frame = null;
    $("link").classList.add("bad");
    text("link", "not connected, trying again");
    setMode("not connected");
    told.status({ status: null });
    panel.silent();
    curtain("No connection", opened || scene ? "The view has ended or does not answer. The page reconnects by itself."
      : "Open the address that the view printed. It ends with a token, which changes with every start.");
  },
  scene(message) {
    scene = message;
    stage?.build(message);
    drawnFrame = null;
    panel.build(message);
    const recorded = isRecording();
    loadMeshes(message);
    text("robot", message.robot.replaceAll("_", " "));
    $("hand").hidden = recorded;
    $("reel").hidden = !recorded;
    $("enable-note").hidden = recorded;
    mix.build(message.about.key_poses);
    showCamera(message.about);
    showHeadset();
    if (recorded) {
      text("name", message.about.name);
      $("at").max = message.about.duration_s;
    }
  },
  status({ status }) {
    text("why", status ? status.cause : "");
    const faults = new Set([...(status?.faults ?? []), ...(status?.latched ?? [])]);
    const tags = [...faults].map((fault) => Object.assign(document.createElement("span"), { textContent: fault }));
    $("faults").replaceChildren(...tags);
    panel.status(status);
  },
  event: (message) => panel.event(message),
  hand(message) {
    hold(message.held);
    text("answer", message.text ?? "");
  },
  mix: (message) => mix.told(message),
  camera: (message) => webcam?.told(message),
  calibrate: (message) => webcam?.calibration(message),
  headset: (message) => headset?.told(message),
  reel: (message) => showPlaying(message.playing),
  frame(message) {
    frame = message;
    isNew = true;
    panel.take(message);
  },
};

function showMode(heard) {
  const silent = frame.present & PRESENT.otherRobot ? "another robot" : isRecording() ? "nothing recorded" : "no instance";
  setMode(heard ? scene.modes[frame.mode] ?? "unknown" : silent);
  if (frame.present === 0 && isRecording()) curtain("Nothing recorded here", "Move the slider to another time.");
  else if (frame.present & PRESENT.otherRobot) curtain("Another robot", `The messages are about another robot than ${scene.robot}. Start the view with the --robot and --config of the instance.`);
  else if (frame.present === 0) curtain("No instance", `No data arrives from ${scene.about.run_dir}. Start an instance there: teleopd up --run-dir ${scene.about.run_dir}. It appears here by itself.`);
  else if (stage?.drawn > 0) curtain("");
  else curtain("Loading", "The picture appears soon. The numbers and buttons work already.");
}

function showTime() {
  if (!sliding) $("at").value = frame.at;
  // The recording stops by itself at its end. If it is played again, frames from the end may still arrive. The
  // numbers of a frame have single precision.
  const over = frame.at >= Math.fround(scene.about.duration_s);
  if (over && !ended) showPlaying(false);
  ended = over;
  text("time", `${frame.at.toFixed(2)} of ${scene.about.duration_s.toFixed(2)} s`);
  panel.later(frame.at);
}

// Returns the layers to draw. With "auto" the target is drawn while the robot is behind it.
function layers(heard) {
  const has = (bit) => (frame.present & bit) !== 0, asked = $("show-target").value;
  const limit = scene.limits.behind_deg;
  isBehind = heard && has(PRESENT.person) && frame.limbMeasured > (isBehind ? limit * GONE : limit);
  return {
    person: has(PRESENT.person) && $("show-person").checked,
    measured: $("show-measured").checked,
    target: has(PRESENT.target) && (asked === "on" || (asked === "auto" && isBehind)),
    command: heard && $("show-command").checked,
    pair: has(PRESENT.pair),
  };
}

function show(now) {
  const heard = (frame.present & PRESENT.command) !== 0;
  showMode(heard);
  if (isRecording()) showTime();
  const shown = layers(heard);
  for (const item of $("legend").children) item.hidden = !shown[item.dataset.layer];
  panel.show(frame, now);
  const layersAre = JSON.stringify(shown);
  // The wearer of a headset does not see this picture, and their own one needs the time.
  if (headset?.session || (isSame(frame, drawnFrame) && layersAre === drawnLayers)) return;
  [drawnFrame, drawnLayers] = [frame, layersAre];
  stage?.update(frame, shown);
}

function draw(now) {
  requestAnimationFrame(draw);
  if (!frame || !scene || !isNew) return;
  isNew = false;
  show(now);
}

function listen() {
  $("stop").addEventListener("click", () => ask("stop"));
  $("engage").addEventListener("click", () => (held ? ask("release") : engage()));
  $("release").addEventListener("click", () => ask("release"));
  $("clutch").addEventListener("pointerdown", (event) => {
    $("clutch").setPointerCapture(event.pointerId);
    clutch(event.pointerId);
  });
  $("clutch").addEventListener("pointerup", (event) => declutch(event.pointerId));
  // A pointer that is lost did not let go.
  $("clutch").addEventListener("pointercancel", (event) => { if (clutched === event.pointerId) ask("release"); });
  $("reset").addEventListener("click", () => { text("answer", ""); ask("reset"); });
  $("play").addEventListener("click", () => play(!playing));
  $("at").addEventListener("pointerdown", () => { sliding = true; });
  for (const end of ["pointerup", "pointercancel"]) $("at").addEventListener(end, () => { sliding = false; });
  $("at").addEventListener("input", () => wire.ask("seek", { to_s: Number($("at").value) }));
  $("drawn-as").addEventListener("change", () => stage?.tell("parts", { kind: $("drawn-as").value }));
  for (const button of document.querySelectorAll("[data-view]")) button.addEventListener("click", () => stage?.tell("look", { view: button.dataset.view }));
  for (const radio of document.querySelectorAll("[name=placing]")) radio.addEventListener("change", () => stage?.tell("place", { placing: radio.value }));
  document.addEventListener("keyup", (event) => { if (event.code === "Space") event.preventDefault(); }, true);
  // Handled before any button gets it. Otherwise Space would press a focused button.
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    if (event.code === "Space") {
      event.preventDefault();
      if (!event.repeat) isRecording() ? play(!playing) : ask("stop");
    } else if (isRecording()) {
      return;
    } else if (event.key === "e" && !event.repeat && !held) {
      engage();
    } else if (event.code === "KeyC" && !event.repeat) {
      clutch("key");
    } else if (event.key === "r" && !event.repeat) {
      ask("release");
    }
  }, true);
  document.addEventListener("keyup", (event) => { if (event.code === "KeyC") declutch("key"); });
  // A window that loses the keyboard does not hear that the key was let go.
  addEventListener("blur", () => { if (clutched !== false) ask("release"); });
  // A hidden page releases the enable, because nobody watches it.
  document.addEventListener("visibilitychange", () => {
    if (document.hidden && (held || clutched !== false)) ask("release");
    if (document.hidden && mix.on) mix.lead(false);
  });
  // Light and dark themes have different colours.
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
    if (scene) stage?.build(scene);
    panel.redraw();
  });
}

// If drawing fails, the numbers and the buttons still work.
function fail(why) {
  broken = why;
  curtain("");
}

curtain("Loading", "Connecting to the view.");
try {
  stage = new Stage($("stage"), [$("tools"), $("legend")], fail);
} catch (error) {
  fail(error.message);
}
const mix = new Mix((what, more) => wire.ask(what, more), $);
const wire = new Wire(location.hash.slice(1), told);
listen();
requestAnimationFrame(draw);
// For tests: the displayed state as numbers.
window.teleopd = {
  frame: () => frame,
  drawn: () => stage?.drawn ?? 0,
  boxes: () => stage?.boxes ?? null,
  ghost: () => stage?.ghost ?? 0,
  share: () => stage?.share ?? 1,
  room: () => headset?.room?.drawn ?? 0,
};
