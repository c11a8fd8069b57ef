// A stand-in for a browser with a headset, injected before the page's own scripts. Its wearer waves the left arm by the clock,
// and trembles as a real one does. `window.mock` sets what the headset offers and what the wearer does. It checks that the
// page calls it as it would call a real one.
(() => {
  const mock = {
    // The sessions and features that the browser grants, and the wearer's inputs: "hands", "controllers" or "none".
    modes: ["immersive-ar", "immersive-vr"], features: ["hand-tracking"], inputs: "hands",
    // Where thumb and index finger are, m, and the left squeeze and right trigger.
    pinch: 0.08, squeeze: 0, trigger: 0,
    head: true, moving: true, frames: 0, session: null, asked: [],
  };
  window.mock = mock;
  const quiet = { x: 0, y: 0, z: 0, w: 1 };
  const pose = (x, y, z, q = quiet, emulatedPosition = false) => ({ emulatedPosition, transform: { position: { x, y, z }, orientation: q, matrix: matrixOf(x, y, z, q), inverse: { matrix: matrixOf(-x, -y, -z, quiet) } } });

  function matrixOf(x, y, z, { x: i, y: j, z: k, w }) {
    return new Float32Array([1 - 2 * (j * j + k * k), 2 * (i * j + k * w), 2 * (i * k - j * w), 0, 2 * (i * j - k * w), 1 - 2 * (i * i + k * k), 2 * (j * k + i * w), 0,
      2 * (i * k + j * w), 2 * (j * k - i * w), 1 - 2 * (i * i + j * j), 0, x, y, z, 1]);
  }

  // The left wrist moves up and down ahead of the wearer, the right one rests.
  function places(at) {
    const t = at / 1000, tremble = (n) => 2e-4 * Math.sin(7 * t + n), wave = mock.moving ? 0.22 * Math.sin(1.3 * t) : 0;
    const turn = { x: Math.sin(0.2 * wave), y: 0, z: 0, w: Math.cos(0.2 * wave) };
    return {
      head: pose(tremble(0), 1.638 + tremble(1), tremble(2)),
      left: pose(-0.2 + tremble(3), 1.15 + wave, -0.38 + tremble(4), turn),
      right: pose(0.2 + tremble(5), 1.1 + tremble(6), -0.38, quiet),
    };
  }

  // A body of the same wearer, by the names of WebXR.
  function bodyAt(at) {
    const { head, left, right } = places(at), of = ({ transform: { position: p } }) => [p.x, p.y, p.z];
    const [h, l, r] = [head, left, right].map(of);
    const elbow = (shoulder, wrist, side) => shoulder.map((x, n) => (x + wrist[n]) / 2 + [side * 0.05, -0.16, 0.06][n]);
    const shoulders = [[-0.18 + h[0], 1.43, 0], [0.18 + h[0], 1.43, 0]];
    const all = {
      hips: [h[0], 0.96, -0.05], "spine-lower": [h[0], 1.05, -0.03], "spine-middle": [h[0], 1.15, -0.02], chest: [h[0], 1.3, -0.01], neck: [h[0], 1.5, 0], head: h,
      "left-shoulder": [-0.05 + h[0], 1.42, 0], "right-shoulder": [0.05 + h[0], 1.42, 0], "left-arm-upper": shoulders[0], "right-arm-upper": shoulders[1],
    };
    // Bones of fixed lengths, as real bodies have them.
    for (const [name, shoulder, wrist, side] of [["left", shoulders[0], l, -1], ["right", shoulders[1], r, 1]]) {
      const unit = (from, to, length) => { const d = to.map((x, n) => x - from[n]), size = Math.hypot(...d); return from.map((x, n) => x + length * d[n] / size); };
      all[`${name}-arm-lower`] = unit(shoulder, elbow(shoulder, wrist, side), 0.32);
      all[`${name}-hand-wrist`] = unit(all[`${name}-arm-lower`], wrist, 0.25);
    }
    return all;
  }

  const NAMES = ["wrist", "thumb-tip", "index-finger-tip"];
  class Session extends EventTarget {
    constructor(mode, features) {
      super();
      Object.assign(this, { mode, visibilityState: "visible", enabledFeatures: features, renderState: { baseLayer: null, depthNear: 0.1, depthFar: 1000 }, callbacks: new Map(), next: 1, isEnded: false, environmentBlendMode: "opaque" });
      const spaces = (side) => new Map(NAMES.map((name) => [name, { side, name }]));
      this.hands = { left: spaces("left"), right: spaces("right") };
      this.bodySpaces = new Map(Object.keys(bodyAt(0)).map((name) => [name, { body: name }]));
      const tick = () => {
        if (this.isEnded) return;
        setTimeout(tick, 14);
        if (this.visibilityState === "hidden" || !this.renderState.baseLayer) return;
        const now = performance.now(), waiting = [...this.callbacks.values()];
        this.callbacks.clear();
        mock.frames += 1;
        for (const callback of waiting) callback(now, new Frame(this, now));
      };
      setTimeout(tick, 14);
    }

    get inputSources() {
      if (mock.inputs === "none") return [];
      return ["left", "right"].map((handedness) => {
        if (mock.inputs === "hands") return { handedness, hand: this.hands[handedness], targetRayMode: "tracked-pointer", targetRaySpace: {}, gripSpace: null, profiles: [] };
        const values = [handedness === "right" ? mock.trigger : 0, handedness === "left" ? mock.squeeze : 0];
        return { handedness, hand: null, gripSpace: { side: handedness }, targetRayMode: "tracked-pointer", targetRaySpace: {}, gamepad: { buttons: values.map((value) => ({ value })), axes: [] }, profiles: [] };
      });
    }

    updateRenderState(state) { Object.assign(this.renderState, state); }
    async requestReferenceSpace(kind) {
      if (kind !== "local-floor") throw new Error(`${kind} is not granted`);
      return { floor: true };
    }
    requestAnimationFrame(callback) { this.callbacks.set(this.next, callback); return this.next++; }
    cancelAnimationFrame(id) { this.callbacks.delete(id); }
    async end() {
      if (this.isEnded) throw new Error("it has ended");
      this.isEnded = true;
      this.dispatchEvent(Object.assign(new Event("end"), { session: this }));
    }
    show(state) { this.visibilityState = state; this.dispatchEvent(new Event("visibilitychange")); }
  }

  class Frame {
    constructor(session, now) {
      // Poses are those of a time to come.
      Object.assign(this, { session, predictedDisplayTime: now + 15, places: places(now + 15) });
      if (session.enabledFeatures.includes("body-tracking")) {
        this.body = session.bodySpaces;
        this.joints = bodyAt(now + 15);
      }
    }

    getViewerPose() {
      if (!mock.head) return null;
      const projectionMatrix = new Float32Array([1.5, 0, 0, 0, 0, 1.5, 0, 0, 0, 0, -1, -1, 0, 0, -0.2, 0]);
      return { ...this.places.head, views: [{ eye: "none", projectionMatrix, transform: this.places.head.transform }] };
    }

    getPose(space, base) {
      if (!base.floor) throw new Error("another space");
      if (space.body) return pose(...this.joints[space.body]);
      return space.side ? this.places[space.side] : null;
    }

    getJointPose(space, base) {
      if (!base.floor) throw new Error("another space");
      const { transform: { position: { x, y, z } } } = this.places[space.side];
      const apart = space.side === "left" ? mock.pinch : 0.06;
      if (space.name === "wrist") return this.places[space.side];
      return pose(x + (space.name === "thumb-tip" ? apart : 0), y, z - 0.12);
    }
  }

  window.XRWebGLLayer = class { constructor(session, gl) { Object.assign(this, { framebuffer: null, framebufferWidth: gl.drawingBufferWidth, framebufferHeight: gl.drawingBufferHeight, ignoreDepthValues: false }); }
    getViewport() { return { x: 0, y: 0, width: this.framebufferWidth, height: this.framebufferHeight }; } };
  delete window.XRWebGLBinding;
  WebGL2RenderingContext.prototype.makeXRCompatible = async () => {};
  Object.defineProperty(navigator, "xr", { value: {
    isSessionSupported: async (mode) => mock.modes.includes(mode),
    requestSession: async (mode, { requiredFeatures, optionalFeatures }) => {
      if (!navigator.userActivation.isActive) throw new Error("only a click may start a session");
      if (!mock.modes.includes(mode)) throw new Error("not supported");
      mock.asked = [mode, ...requiredFeatures, ...optionalFeatures];
      mock.session = new Session(mode, [...requiredFeatures, ...optionalFeatures.filter((one) => mock.features.includes(one))]);
      return mock.session;
    },
  } });
})();
