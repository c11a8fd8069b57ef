// The poses of a WebXR session as a message, as `headset/message.rs` reads it. The server does all arithmetic.

// Joints of a tracked body, in the order of SMPL-22.
const BODY = ["hips", "left-upper-leg", "right-upper-leg", "spine-lower", "left-lower-leg", "right-lower-leg", "spine-middle", "left-foot-ankle",
  "right-foot-ankle", "chest", "left-foot-ball", "right-foot-ball", "neck", "left-shoulder", "right-shoulder", "head", "left-arm-upper",
  "right-arm-upper", "left-arm-lower", "right-arm-lower", "left-hand-wrist", "right-hand-wrist"];
// Numbers of a pose and of a hand. A pose that is not known has a confidence of 0.
const NOWHERE = [0, 0, 0, 0, 0, 0, 1, 0];
const [WRIST, GRIP] = [0, 1];
const NO_HAND = [WRIST, ...NOWHERE, -1, -1, -1];
// Buttons of a controller in WebXR's standard mapping.
const [TRIGGER, SQUEEZE] = [0, 1];
// Largest distance that is sent, m.
const PINCH_MAX = 0.5;

function numbers(pose) {
  if (!pose) return NOWHERE;
  const { position: p, orientation: q } = pose.transform;
  return [p.x, p.y, p.z, q.x, q.y, q.z, q.w, pose.emulatedPosition ? 0.5 : 1];
}

export class Sending {
  // `stature` is 0 if the user gave none.
  constructor(session, floor, stature) {
    Object.assign(this, { session, floor, stature: stature >= 1.2 && stature <= 2.2 ? stature : 0, way: Infinity, since: 0 });
  }

  asked() {
    this.since = performance.now();
  }

  // The server answered a request, or the message that was sent at `sent`. The way there takes no longer than there and back.
  heard(sent) {
    this.way = Math.min(this.way, performance.now() - (sent ?? this.since));
  }

  // Returns the message about a frame. Its poses are those of the time at which it is shown. Poses of a time to come count as
  // new, and every pose is older by the message's way.
  frame(at, frame, now) {
    const age = Math.max(0, now - (frame.predictedDisplayTime ?? at)) + this.way;
    // The wearer does not look into the scene while a menu of the headset lies over it.
    const isSeen = this.session.visibilityState === "visible";
    const head = isSeen ? numbers(frame.getViewerPose(this.floor)) : NOWHERE;
    const hands = ["left", "right"].map((side) => this.hand(frame, side));
    const body = isSeen ? this.body(frame) : [];
    const all = [this.stature, ...head, ...hands.flat(), ...body];
    const bytes = new ArrayBuffer(16 + 4 * all.length);
    new Float64Array(bytes, 0, 2).set([now, age]);
    new Float32Array(bytes, 16).set(all);
    const kind = body.length > 0 ? "body tracking" : hands.some(([what]) => what === GRIP) ? "head and controllers" : "head and hands";
    return { bytes, age, kind };
  }

  hand(frame, side) {
    const source = [...this.session.inputSources].find((one) => one.handedness === side && (one.hand || one.gripSpace));
    if (!source) return NO_HAND;
    if (source.hand) {
      const joint = (name) => { const space = source.hand.get(name); return space ? frame.getJointPose(space, this.floor) : null; };
      const [thumb, index] = [joint("thumb-tip"), joint("index-finger-tip")].map((pose) => pose?.transform.position);
      const pinch = thumb && index ? Math.min(PINCH_MAX, Math.hypot(thumb.x - index.x, thumb.y - index.y, thumb.z - index.z)) : -1;
      return [WRIST, ...numbers(joint("wrist")), pinch, -1, -1];
    }
    const value = (button) => source.gamepad?.buttons[button]?.value ?? -1;
    return [GRIP, ...numbers(frame.getPose(source.gripSpace, this.floor)), -1, value(TRIGGER), value(SQUEEZE)];
  }

  // Returns the joints of the body by their names, or none without body tracking.
  body(frame) {
    const { body } = frame;
    if (!body || body.size === 0) return [];
    return BODY.flatMap((name) => { const space = body.get(name); return numbers(space ? frame.getPose(space, this.floor) : null); });
  }
}
