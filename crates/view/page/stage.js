// The canvas, seen from the page: where one looks from, and what the artist is told. See `artist.js`.

export class Stage {
  // `trouble` is told what keeps the artist from drawing.
  constructor(canvas, trouble) {
    this.canvas = canvas;
    this.drawn = 0;
    this.eye = { yaw: 0.55, pitch: 0.22, distance: 3.9, at: [0.1, 0.7, 0.85] };
    this.artist = new Worker("./artist.js", { type: "module" });
    this.artist.onmessage = ({ data }) => (data.trouble ? trouble(data.trouble) : (this.drawn = data.drawn));
    this.artist.onerror = (event) => trouble(event.message ?? "the artist cannot be loaded");
    const paper = canvas.transferControlToOffscreen();
    this.artist.postMessage({ do: "canvas", canvas: paper }, [paper]);
    new ResizeObserver(() => this.resize()).observe(canvas);
    this.resize();
    this.tell("look", this.eye);
    this.hold();
  }

  tell(what, more) {
    this.artist.postMessage({ do: what, ...more });
  }

  resize() {
    const scale = Math.min(window.devicePixelRatio || 1, 2);
    this.tell("resize", { width: this.canvas.clientWidth, height: this.canvas.clientHeight, scale });
  }

  build(told) {
    const style = getComputedStyle(document.documentElement);
    const names = ["person", "measured", "target", "command", "bad"];
    this.tell("build", { told, colours: Object.fromEntries(names.map((name) => [name, style.getPropertyValue(`--${name}`).trim()])) });
  }

  parts(capsules, shapes) {
    this.tell("parts", { capsules, shapes });
  }

  update(frame, shown) {
    this.tell("update", { frame, shown });
  }

  // Drag turns, shift or two fingers move, the wheel or a pinch comes nearer.
  hold() {
    const held = new Map();
    const { canvas, eye } = this;
    canvas.addEventListener("pointerdown", (event) => { canvas.setPointerCapture(event.pointerId); held.set(event.pointerId, event); });
    for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, (event) => held.delete(event.pointerId));
    canvas.addEventListener("pointermove", (event) => {
      const before = held.get(event.pointerId);
      if (!before) return;
      const [dx, dy] = [event.clientX - before.clientX, event.clientY - before.clientY];
      if (held.size === 2) {
        const other = [...held.values()].find((one) => one.pointerId !== event.pointerId);
        const apart = (one) => Math.hypot(one.clientX - other.clientX, one.clientY - other.clientY);
        this.nearer(apart(before) / Math.max(apart(event), 1));
      }
      if (event.shiftKey || held.size === 2) {
        const step = eye.distance / canvas.clientHeight * 0.7;
        eye.at[0] += (Math.sin(eye.yaw) * dx - Math.sin(eye.pitch) * Math.cos(eye.yaw) * dy) * step;
        eye.at[1] += (-Math.cos(eye.yaw) * dx - Math.sin(eye.pitch) * Math.sin(eye.yaw) * dy) * step;
        eye.at[2] += Math.cos(eye.pitch) * dy * step;
      } else {
        eye.yaw -= dx * 0.006;
        eye.pitch = Math.min(1.5, Math.max(-0.3, eye.pitch + dy * 0.006));
      }
      held.set(event.pointerId, event);
      this.tell("look", eye);
    });
    canvas.addEventListener("wheel", (event) => { event.preventDefault(); this.nearer(Math.exp(event.deltaY * 0.001)); }, { passive: false });
  }

  nearer(factor) {
    this.eye.distance = Math.min(15, Math.max(0.6, this.eye.distance * factor));
    this.tell("look", this.eye);
  }
}
