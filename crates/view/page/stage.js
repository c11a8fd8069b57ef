// The canvas on the page's side: messages to the artist, and pointer input. See `artist.js`.

// Colours of the theme that the artist needs.
const COLOURS = ["person", "target", "command", "bad", "grid", "shadow"];
// Pixels per step of an arrow key.
const STEP = 24;

export class Stage {
  // `trouble` is called if the artist cannot draw. `tools` are the elements that cover the canvas.
  constructor(canvas, tools, trouble) {
    Object.assign(this, { canvas, tools, drawn: 0, boxes: null, ghost: 0, share: 1 });
    this.artist = new Worker("./artist.js", { type: "module" });
    this.artist.onmessage = ({ data }) => {
      if (data.trouble) trouble(data.trouble);
      else Object.assign(this, data);
    };
    this.artist.onerror = (event) => trouble(event.message ?? "the drawing code cannot be loaded");
    const paper = canvas.transferControlToOffscreen();
    this.artist.postMessage({ do: "canvas", canvas: paper, quality: new URLSearchParams(location.search).get("quality") }, [paper]);
    new ResizeObserver(() => this.resize()).observe(canvas);
    this.resize();
    this.hold();
  }

  tell(what, more, transfer = []) {
    this.artist.postMessage({ do: what, ...more }, transfer);
  }

  // Keeps figures clear of the controls at the canvas' upper and lower edge.
  resize() {
    const scale = Math.min(window.devicePixelRatio || 1, 2), all = this.canvas.getBoundingClientRect();
    const inset = { left: 0, right: 0, top: 0, bottom: 0 };
    for (const tool of this.tools) {
      const box = tool.getBoundingClientRect();
      if (box.height === 0) continue;
      if (box.top - all.top < all.height / 2) inset.top = Math.max(inset.top, box.bottom - all.top);
      else inset.bottom = Math.max(inset.bottom, all.bottom - box.top);
    }
    this.tell("resize", { width: this.canvas.clientWidth, height: this.canvas.clientHeight, scale, inset });
  }

  build(told) {
    const style = getComputedStyle(document.documentElement);
    this.tell("build", { told, colours: Object.fromEntries(COLOURS.map((name) => [name, style.getPropertyValue(`--${name}`).trim()])) });
  }

  update(frame, shown) {
    this.tell("update", { frame, shown });
  }

  // Drag or arrow keys turn. Shift and drag, or two fingers, move. The wheel, a pinch, + and - zoom.
  hold() {
    const held = new Map(), { canvas } = this;
    canvas.addEventListener("pointerdown", (event) => { canvas.setPointerCapture(event.pointerId); held.set(event.pointerId, event); });
    for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, (event) => held.delete(event.pointerId));
    canvas.addEventListener("pointermove", (event) => {
      const before = held.get(event.pointerId);
      if (!before) return;
      const [dx, dy] = [event.clientX - before.clientX, event.clientY - before.clientY];
      if (held.size === 2) {
        const other = [...held.values()].find((one) => one.pointerId !== event.pointerId);
        const apart = (one) => Math.hypot(one.clientX - other.clientX, one.clientY - other.clientY);
        this.tell("zoom", { factor: apart(before) / Math.max(apart(event), 1) });
      }
      this.tell(event.shiftKey || held.size === 2 ? "move" : "turn", { dx, dy });
      held.set(event.pointerId, event);
    });
    canvas.addEventListener("wheel", (event) => { event.preventDefault(); this.tell("zoom", { factor: Math.exp(event.deltaY * 0.001) }); }, { passive: false });
    canvas.addEventListener("keydown", (event) => {
      if (event.ctrlKey || event.altKey || event.metaKey) return;
      const way = { ArrowLeft: [STEP, 0], ArrowRight: [-STEP, 0], ArrowUp: [0, STEP], ArrowDown: [0, -STEP] }[event.key];
      const factor = { "+": 0.9, "=": 0.9, "-": 1.1 }[event.key];
      if (!way && !factor) return;
      event.preventDefault();
      if (factor) this.tell("zoom", { factor });
      else this.tell(event.shiftKey ? "move" : "turn", { dx: way[0], dy: way[1] });
    });
  }
}
