// A headset as a client (WebXR). The page sends poses, and the server makes the person and judges the press. Only the button
// starts it. Whatever ends it, it stays off until the button is pressed again.

import { Sending } from "./headset-poses.js";

// Features that are used where the headset and its wearer grant them.
const OPTIONAL = ["body-tracking", "hand-tracking"];
// `ingest` drops older poses, and engages at no lower rate.
const [AGE_MAX, RATE_MIN] = [100, 15];
// Time between two texts, ms.
const EVERY = 250;

// Returns the kind of session that this browser offers: with the room visible, else without, else null.
export async function offered() {
  for (const mode of ["immersive-ar", "immersive-vr"]) {
    if (await navigator.xr?.isSessionSupported(mode).catch(() => false)) return mode;
  }
  return null;
}

export class Headset {
  // `wire` sends to the server. `$` finds an element. `picture` returns what is drawn: { scene, meshes, frame, shown, told }.
  constructor(wire, $, mode, picture) {
    Object.assign(this, { wire, $, mode, picture, session: null, run: 0, on: false, isAsked: false, told_at: 0, times: [], age: 0, kind: "" });
    $("xr-on").addEventListener("click", () => (this.session || this.isAsked ? this.stop("") : this.start()));
    document.addEventListener("visibilitychange", () => { if (document.hidden) this.stop("The page was hidden, so the headset is off."); });
    this.show("off");
  }

  text(value) {
    if (this.$("xr-told").textContent !== value) this.$("xr-told").textContent = value;
  }

  show(state) {
    this.$("xr-on").textContent = this.session || this.isAsked ? "Stop the headset" : "Headset";
    this.$("xr-state").textContent = state;
  }

  async start() {
    const run = ++this.run;
    this.isAsked = true;
    this.text("");
    this.show("waiting for the headset");
    try {
      // The browser grants a session to a click only, so this comes first.
      const session = await navigator.xr.requestSession(this.mode, { requiredFeatures: ["local-floor"], optionalFeatures: OPTIONAL });
      if (run !== this.run) return session.end();
      this.session = session;
      const ended = () => { if (run === this.run) this.stop("The headset ended the session."); };
      session.addEventListener("end", ended);
      const { Room } = await import("./headset-room.js");
      const floor = await session.requestReferenceSpace("local-floor");
      if (run !== this.run) return;
      this.sending = new Sending(session, floor, Number(this.$("xr-stature").value));
      this.room = new Room(this.picture, this.mode === "immersive-ar");
      await this.room.begin(session, (at, frame) => { if (run === this.run) this.see(at, frame); });
      if (run !== this.run) return;
      this.sending.asked();
      if (!this.wire.ask("headset", { on: true })) return this.stop("Not connected, so the headset is off.");
      this.show("waits for the lease");
    } catch (error) {
      if (run === this.run) this.stop(`The headset cannot be used: ${error.message}`);
    }
  }

  // Ends everything. It also tells the server, so that nothing is published and no press is held any more.
  stop(why) {
    if (!this.session && !this.isAsked) return;
    this.run += 1;
    this.wire.ask("headset", { on: false });
    this.room?.end();
    this.session?.end().catch(() => {});
    Object.assign(this, { session: null, isAsked: false, on: false, room: null, sending: null, times: [] });
    this.text(why);
    this.show("off");
  }

  // A frame of the session. Its poses leave before it is drawn.
  see(at, frame) {
    const now = performance.now();
    if (this.on) {
      const { bytes, age, kind } = this.sending.frame(at, frame, now);
      if (!this.wire.send(bytes)) return this.stop("Not connected, so the headset is off.");
      Object.assign(this, { age, kind });
      this.times = [...this.times.filter((time) => now - time < 1000), now];
    }
    this.room.draw(frame);
    if (now - this.told_at > EVERY) this.tell(now);
  }

  tell(now) {
    this.told_at = now;
    if (!this.on) return;
    const rate = this.times.length;
    const slow = this.times[0] < now - 900 && rate < RATE_MIN ? `, at least ${RATE_MIN} are needed` : "";
    const old = this.age > AGE_MAX ? `, at most ${AGE_MAX} ms may be` : "";
    this.show(`leads the robot with ${this.kind}: ${rate} frames a second${slow}, ${this.age.toFixed(0)} ms old${old}`);
  }

  // The server's report. A person that ended by itself turns the headset off.
  told({ on, refused, text, heard_ms: heard }) {
    if (!this.sending) return;
    if (on) this.sending.heard(heard);
    if (!on && (text || this.on)) return this.stop(text ?? "The person ended.");
    this.on = on;
    this.text(text ? `${text} ${refused} so far.` : "");
  }
}
