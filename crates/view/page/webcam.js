// The webcam as a client. A worker finds the person in each image, and the server publishes the landmarks. Only the
// button starts it. Whatever ends it, it stays off until the button is pressed again.

// Landmarks of MediaPipe's layout: shoulder, elbow and wrist of each arm.
const ARMS = { left: [11, 13, 15], right: [12, 14, 16] };
const BONES = [[11, 12], [11, 13], [13, 15], [12, 14], [14, 16], [11, 23], [12, 24], [23, 24], [23, 25], [25, 27], [24, 26], [26, 28], [0, 11], [0, 12]];
const LANDMARKS = 33;
// A landmark below it is drawn dim, and its arm is called unsure.
const SURE = 0.5;
// Without an image for this long, the camera has stalled, ms. The server ends the person after the same time.
const STALLED = 500;
// The landmarker needs longer for its first image, because it prepares itself, ms.
const FIRST = 20000;
// `ingest` drops older images, and engages at no lower rate.
const [AGE_MAX, RATE_MIN] = [100, 15];
// Where the browser keeps the person's name.
const NAME = "teleopd-person";

// Returns each landmark in the world with its place in the image: heights of the image from its middle. `wide` is the image's
// breadth in its heights.
export function joined(inWorld, inImage, wide) {
  return inWorld?.map((mark, n) => [...mark, (inImage[n][0] - 0.5) * wide, inImage[n][1] - 0.5]) ?? null;
}

// Returns the message about an image, as `sight.rs` reads it: the times, then the switch and the landmarks.
export function encode(sent, age, mirrored, marks) {
  const bytes = new ArrayBuffer(marks ? 16 + 4 * (1 + 6 * LANDMARKS) : 16);
  new Float64Array(bytes, 0, 2).set([sent, age]);
  if (marks) new Float32Array(bytes, 16).set([mirrored ? 1 : 0, ...marks.flat()]);
  return bytes;
}

// Returns how sure the landmarker is of an arm, from 0 to 1: that of its worst joint.
export function confidence(marks, arm) {
  return marks ? Math.min(...ARMS[arm].map((n) => marks[n][3])) : 0;
}

// What to do about an error of the browser, by its name.
const REMEDIES = {
  NotAllowedError: "Allow the camera beside the address bar, then press the button again.",
  NotFoundError: "No camera was found: plug one in, then press the button again.",
  NotReadableError: "Another program may use it: end that one, then press the button again.",
};

export class Webcam {
  // `wire` sends to the server. `$` finds an element. `base` is the address of the user's files.
  constructor(wire, $, base) {
    Object.assign(this, { wire, $, base, stream: null, worker: null, run: 0, on: false, asked: false, busy: false, times: [], watch: null, measures: false });
    $("cam-on").addEventListener("click", () => (this.stream || this.worker ? this.stop("") : this.start()));
    $("cal").addEventListener("submit", (event) => {
      event.preventDefault();
      if (!this.measures && !this.on) return ($("cal-told").textContent = "Start the camera first, and wait until it leads the robot.");
      this.wire.ask("calibrate", this.measures ? {} : { name: this.name() });
    });
    $("cam-mirrored").addEventListener("click", () => this.mirror(!this.mirrored));
    document.addEventListener("visibilitychange", () => { if (document.hidden) this.stop("The page was hidden, so the camera is off."); });
    // A hidden video shows no images.
    $("cam").addEventListener("toggle", () => { if (!$("cam").open) this.stop("The panel was closed, so the camera is off."); });
    $("cal-name").value = localStorage.getItem(NAME) ?? "";
    $("cal-name").addEventListener("change", () => localStorage.setItem(NAME, this.name() ?? ""));
    this.mirror(false);
    this.show("off");
  }

  // The person's name, or none. Its measurement is used.
  name() {
    const { value, validity } = this.$("cal-name");
    return validity.valid ? value : undefined;
  }

  // The switch says that the image itself is mirrored. The preview always looks like a mirror.
  mirror(now) {
    this.mirrored = now;
    this.$("cam-mirrored").setAttribute("aria-checked", String(now));
    this.$("cam-view").classList.toggle("turned", !now);
  }

  text(value) {
    if (this.$("cam-told").textContent !== value) this.$("cam-told").textContent = value;
  }

  show(state) {
    this.$("cam-on").textContent = this.stream || this.worker ? "Stop the camera" : "Start the camera";
    this.$("cam-state").textContent = state;
  }

  async start() {
    const run = ++this.run;
    this.text("");
    try {
      this.worker = new Worker("webcam-worker.js", { type: "module" });
      this.worker.onmessage = ({ data }) => { if (run === this.run) this.hear(data); };
      this.worker.onerror = (event) => { if (run === this.run) this.stop(`The landmarker failed: ${event.message ?? "it could not be loaded"}`); };
      this.show("waiting for the camera");
      const stream = await navigator.mediaDevices.getUserMedia({ audio: false, video: { width: 640, height: 480, frameRate: { ideal: 30 } } });
      // It may have been stopped while the user was asked.
      if (run !== this.run) return stream.getTracks().forEach((track) => track.stop());
      this.stream = stream;
      const ended = () => { if (run === this.run) this.stop("The camera ended."); };
      stream.getVideoTracks().forEach((track) => track.addEventListener("ended", ended));
      const video = this.$("cam-video");
      video.srcObject = stream;
      await video.play();
      if (run !== this.run) return;
      this.show("loading the landmarker");
      this.worker.postMessage({ base: this.base });
    } catch (error) {
      if (run === this.run) this.stop(`The camera cannot be used: ${[error.message, REMEDIES[error.name]].filter(Boolean).join(". ")}`);
    }
  }

  // Turns everything off. It also tells the server, so that nothing is published any more.
  stop(why) {
    if (!this.stream && !this.worker) return;
    this.run += 1;
    clearInterval(this.watch);
    this.worker?.terminate();
    this.stream?.getTracks().forEach((track) => track.stop());
    this.$("cam-video").srcObject = null;
    if (this.asked) this.wire.ask("camera", { on: false });
    Object.assign(this, { stream: null, worker: null, on: false, asked: false, busy: false, times: [] });
    this.draw(null);
    for (const arm of Object.keys(ARMS)) this.showArm(arm, 0, false);
    this.text(why);
    this.show("off");
  }

  hear({ ready, failed, at, wide, inImage, inWorld }) {
    if (failed) return this.stop(`The landmarker failed: ${failed}`);
    if (ready) {
      this.seenAt = performance.now();
      const run = this.run;
      this.watch = setInterval(() => this.check(), STALLED / 5);
      return this.next(run);
    }
    this.busy = false;
    this.report(at, wide, inImage, inWorld);
  }

  check() {
    const [limit, time] = this.times.length > 0 ? [STALLED, "half a second"] : [FIRST, "20 s"];
    if (performance.now() - this.seenAt > limit) this.stop(`No image came for ${time}: the camera or this machine is too slow. The camera is off.`);
  }

  // Gives each image to the worker until the run ends.
  next(run) {
    const [track] = this.stream.getVideoTracks();
    // The camera's own images come even where the page draws slowly. Not every browser has them.
    if (window.MediaStreamTrackProcessor) return this.read(run, new MediaStreamTrackProcessor({ track, maxBufferSize: 1 }).readable.getReader());
    const video = this.$("cam-video");
    video.requestVideoFrameCallback(async (now, { captureTime }) => {
      if (run !== this.run) return;
      this.next(run);
      if (this.busy) return;
      try {
        this.give(run, await createImageBitmap(video), captureTime ?? now);
      } catch (error) {
        if (run === this.run) this.stop(`The image cannot be read: ${error.message}`);
      }
    });
  }

  async read(run, reader) {
    try {
      for (;;) {
        const { value, done } = await reader.read();
        if (done || run !== this.run) return value?.close();
        this.give(run, value, value.metadata?.().captureTime ?? performance.now());
      }
    } catch (error) {
      if (run === this.run) this.stop(`The image cannot be read: ${error.message}`);
    } finally {
      reader.cancel().catch(() => {});
    }
  }

  // An image that comes while another one is examined is left out. None waits. Where the browser does not say when an image
  // was taken, it counts from its arrival.
  give(run, image, at) {
    if (this.busy || run !== this.run) return image.close();
    this.busy = true;
    this.worker.postMessage({ image, at }, [image]);
  }

  report(at, wide, inImage, inWorld) {
    const now = performance.now(), age = Math.max(0, now - at);
    this.seenAt = now;
    this.times = [...this.times.filter((time) => now - time < 1000), now];
    // The first image asks for the lease. Before that the landmarker loads, which takes seconds.
    if (!this.asked) this.asked = this.wire.ask("camera", { on: true, name: this.name() });
    if (!this.asked || !this.wire.send(encode(now, age, this.mirrored, joined(inWorld, inImage, wide)))) return this.stop("Not connected, so the camera is off.");
    this.age = age;
    this.draw(inImage);
    for (const arm of Object.keys(ARMS)) this.showArm(arm, confidence(inWorld, arm), inWorld !== null);
    this.showState(inWorld !== null);
  }

  showState(seen) {
    const rate = this.times.length, notes = [`${rate} images a second`, `${this.age.toFixed(0)} ms old`];
    const slow = this.times[0] < performance.now() - 900 && rate < RATE_MIN ? `, at least ${RATE_MIN} are needed` : "";
    const old = this.age > AGE_MAX ? `, at most ${AGE_MAX} ms may be` : "";
    const who = !this.on ? "waits for the lease" : slow || old ? "cannot lead the robot" : "leads the robot";
    this.show(`${who}: ${seen ? "" : "nobody is seen, "}${notes[0]}${slow}, ${notes[1]}${old}`);
  }

  showArm(arm, value, seen) {
    this.$(`cam-${arm}`).value = value;
    const word = !seen ? "–" : value < SURE ? `${(100 * value).toFixed(0)} %, unsure` : `${(100 * value).toFixed(0)} %`;
    this.$(`cam-${arm}-text`).textContent = word;
  }

  // The server's report. A person that ended by itself turns the camera off.
  told({ on, refused, text }) {
    if (text && !on) this.stop(text);
    else if (this.on && !on) this.stop("The person ended.");
    else if (this.stream) {
      this.on = on;
      this.text(text ? `${text} ${refused} so far.` : "");
    }
  }

  // The report about a measurement. The server takes a written one into use.
  calibration({ on, written, text }) {
    this.measures = on;
    this.$("cal-on").textContent = on ? "Stop calibrating" : "Calibrate";
    this.$("cal-name").disabled = on;
    if (text) this.$("cal-told").textContent = text;
    if (written) this.$("cal-told").textContent = "Measured. The camera uses it from now on.";
  }

  draw(marks) {
    const canvas = this.$("cam-canvas"), video = this.$("cam-video"), pen = canvas.getContext("2d");
    if (video.videoWidth > 0 && canvas.width !== video.videoWidth) [canvas.width, canvas.height] = [video.videoWidth, video.videoHeight];
    pen.clearRect(0, 0, canvas.width, canvas.height);
    if (!marks) return;
    const colour = getComputedStyle(canvas).getPropertyValue("--person");
    Object.assign(pen, { lineWidth: canvas.width / 120, lineCap: "round", strokeStyle: colour, fillStyle: colour });
    const place = ([x, y]) => [x * canvas.width, y * canvas.height], sure = ([, , , visibility]) => visibility >= SURE;
    for (const [a, b] of BONES) {
      pen.globalAlpha = sure(marks[a]) && sure(marks[b]) ? 1 : 0.25;
      pen.beginPath();
      pen.moveTo(...place(marks[a]));
      pen.lineTo(...place(marks[b]));
      pen.stroke();
    }
    for (const mark of marks.slice(11)) {
      pen.globalAlpha = sure(mark) ? 1 : 0.25;
      pen.beginPath();
      pen.arc(...place(mark), canvas.width / 90, 0, 2 * Math.PI);
      pen.fill();
    }
  }
}
