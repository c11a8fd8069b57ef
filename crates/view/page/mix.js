// The triangle of three key poses. The handle is the requested mix. The dot shows the server's person and follows
// the handle.

// Corners in the drawing, which is 120 wide and 100 high.
const CORNERS = [[14, 84], [106, 84], [60, 8]];
// Period of the repeated request while it is on, ms. The server stops the person after 500 ms of silence.
const KEEP = 100;
// Distance that an arrow key moves the handle, in the drawing.
const STEP = 2;

// Returns the shares of the corners at a point. A point outside the triangle uses the nearest point of the
// triangle.
export function sharesAt(at) {
  const [a, b, c] = CORNERS;
  const cross = ([ax, ay], [bx, by], [px, py]) => (bx - ax) * (py - ay) - (by - ay) * (px - ax);
  const inside = [cross(b, c, at), cross(c, a, at), cross(a, b, at)].map((part) => part / cross(a, b, c));
  if (inside.every((share) => share >= 0)) return inside;
  const onEdges = [0, 1, 2].map((n) => {
    const m = (n + 1) % 3, [[ax, ay], [bx, by]] = [CORNERS[n], CORNERS[m]];
    const along = ((at[0] - ax) * (bx - ax) + (at[1] - ay) * (by - ay)) / ((bx - ax) ** 2 + (by - ay) ** 2);
    const shares = [0, 0, 0];
    shares[m] = Math.min(1, Math.max(0, along));
    shares[n] = 1 - shares[m];
    return shares;
  });
  const away = (shares) => Math.hypot(...pointOf(shares).map((x, axis) => x - at[axis]));
  return onEdges.reduce((one, other) => (away(other) < away(one) ? other : one));
}

export function pointOf(shares) {
  return [0, 1].map((axis) => shares.reduce((sum, share, n) => sum + share * CORNERS[n][axis], 0));
}

export class Mix {
  // `ask` sends a request to the server. `$` finds an element.
  constructor(ask, $) {
    Object.assign(this, { ask, $, on: false, names: [], keeping: null, held: null });
    this.shares = [1, 0, 0];
    const handle = $("mix-handle"), plane = $("mix-plane");
    plane.addEventListener("pointerdown", (event) => {
      plane.setPointerCapture(event.pointerId);
      this.held = event.pointerId;
      this.follow(event);
      handle.focus();
      event.preventDefault();
    });
    plane.addEventListener("pointermove", (event) => { if (event.pointerId === this.held) this.follow(event); });
    for (const end of ["pointerup", "pointercancel"]) plane.addEventListener(end, () => { this.held = null; });
    handle.addEventListener("keydown", (event) => {
      const way = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
      if (!way || event.ctrlKey || event.altKey || event.metaKey) return;
      event.preventDefault();
      const at = pointOf(this.shares);
      this.go(sharesAt([0, 1].map((axis) => at[axis] + way[axis] * STEP)));
    });
    $("mix-on").addEventListener("click", () => this.lead(!this.on));
  }

  // Shows the corner names. Without names there are no key poses, so the triangle is hidden.
  build(names) {
    this.$("mix").hidden = !names;
    this.names = names ?? [];
    this.names.forEach((name, n) => { this.$(`mix-${"abc"[n]}`).textContent = name; });
    this.told({ on: false, shares: [1, 0, 0] });
    this.go([1, 0, 0]);
  }

  lead(now) {
    this.$("mix-told").textContent = "";
    if (!this.ask(now ? "join" : "leave")) this.$("mix-told").textContent = "Not connected: the request was not sent.";
  }

  told({ on, shares, text }) {
    if (on && !this.on) this.keeping = setInterval(() => this.say(), KEEP);
    if (!on) clearInterval(this.keeping);
    const changed = on !== this.on;
    this.on = on;
    this.$("mix-on").setAttribute("aria-checked", String(on));
    if (shares) this.place("mix-person", shares);
    if (text || changed) this.$("mix-told").textContent = text ?? "";
    if (on && changed) this.say();
  }

  say() {
    this.ask("mix", { shares: this.shares });
  }

  follow(event) {
    const box = this.$("mix-plane").getScreenCTM().inverse();
    const at = new DOMPoint(event.clientX, event.clientY).matrixTransform(box);
    this.go(sharesAt([at.x, at.y]));
  }

  go(shares) {
    this.shares = shares;
    const handle = this.$("mix-handle");
    const percent = shares.map((share) => Math.round(100 * share));
    handle.setAttribute("aria-valuenow", percent[0]);
    handle.setAttribute("aria-valuetext", this.names.map((name, n) => `${name} ${percent[n]} %`).join(", "));
    this.$("mix-shares").textContent = handle.getAttribute("aria-valuetext");
    this.place("mix-handle", shares);
    if (this.on) this.say();
  }

  place(id, shares) {
    const [x, y] = pointOf(shares);
    this.$(id).setAttribute("cx", x);
    this.$(id).setAttribute("cy", y);
  }
}
