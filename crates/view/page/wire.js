// The connection. Texts are JSON. Frames are little-endian 32-bit floats in the order of the server's `frame`
// module.

export const VERSION = 6;
export const FIELDS = ["version", "at", "mode", "present", "age", "late", "clearance", "pairA", "pairB", "limbTarget",
  "limbMeasured", "speed", "targetMask", "lag", "gripLeft", "gripRight", "forceLeft", "forceRight"];
export const PRESENT = { person: 1, measured: 2, target: 4, command: 8, pair: 16, lag: 32, otherRobot: 64, oneCamera: 128 };
const PERSON = 22, TURNS = 14, POSE = 7;
// Time before the next attempt to connect, ms.
const AGAIN = 500;
// Period of the heartbeat of a passive page, ms. The server waits ten seconds for it.
const HERE = 2000;

// Decodes a frame of a robot with this many joints. It has one body more.
export function decode(buffer, joints) {
  const all = new Float32Array(buffer);
  if (all[0] !== VERSION) throw new Error(`frames of version ${all[0]}, not ${VERSION}: load the page again`);
  const poses = (joints + 1) * POSE, length = FIELDS.length + 12 + 3 * PERSON + TURNS + 3 * poses + 4 * joints;
  if (all.length !== length) throw new Error(`a frame of ${all.length} numbers, not ${length}`);
  const frame = { all };
  FIELDS.forEach((name, n) => { frame[name] = all[n]; });
  let at = FIELDS.length;
  const take = (count) => all.subarray(at, at += count);
  frame.pair = take(12);
  frame.person = take(3 * PERSON);
  frame.turns = take(TURNS);
  frame.poses = { measured: take(poses), target: take(poses), command: take(poses) };
  frame.q = { measured: take(joints), target: take(joints), command: take(joints) };
  frame.v = take(joints);
  return frame;
}

// Returns true if two frames show the same, whatever their time.
export function isSame(a, b) {
  if (!a || !b || a.all.length !== b.all.length) return false;
  for (let n = 2; n < a.all.length; n += 1) if (a.all[n] !== b.all[n]) return false;
  return true;
}

export class Wire {
  // `told` has a function for each kind of text, and for `frame`, `up` and `down`.
  constructor(token, told) {
    this.token = token;
    this.told = told;
    // Number of the robot's joints. The scene, which comes first, tells it.
    this.joints = 0;
    setInterval(() => this.ask("here"), HERE);
    this.connect();
  }

  connect() {
    const socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/live?token=${this.token}`);
    socket.binaryType = "arraybuffer";
    let opened = false;
    socket.onopen = () => { opened = true; this.told.up(); };
    socket.onmessage = ({ data }) => {
      if (typeof data === "string") {
        const message = JSON.parse(data);
        if (message.tell === "scene") this.joints = message.joints.length;
        this.told[message.tell]?.(message);
      } else {
        this.told.frame(decode(data, this.joints));
      }
    };
    socket.onclose = () => {
      this.told.down(opened);
      setTimeout(() => this.connect(), AGAIN);
    };
    this.socket = socket;
  }

  // Returns true if the request was sent.
  ask(what, more = {}) {
    if (this.socket.readyState !== WebSocket.OPEN) return false;
    this.socket.send(JSON.stringify({ do: what, ...more }));
    return true;
  }

  // Sends bytes. Returns true if they were sent.
  send(bytes) {
    if (this.socket.readyState !== WebSocket.OPEN) return false;
    this.socket.send(bytes);
    return true;
  }
}
