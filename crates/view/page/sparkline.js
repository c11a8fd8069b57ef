// A small chart of the last seconds, with its scale, limit and time. Constants without a source were chosen by
// eye: assumptions.

const KEPT_S = 10, GAP_S = 0.5, ROOM = { top: 4, right: 30, bottom: 13 }, DOT_PX = 2.5;

export class Sparkline {
  // The scale starts at zero, grows with the values, and never ends below `least`. `limit` is drawn as a line.
  constructor(canvas, { least, digits = 0 }) {
    Object.assign(this, { canvas, least, digits, limit: null });
    [this.times, this.values] = [[], []];
  }

  clear() {
    this.times.length = this.values.length = 0;
  }

  add(at, value) {
    const { times, values } = this, last = times.at(-1);
    // A paused recording repeats its last frame.
    if (at === last) {
      values[values.length - 1] = value;
      return;
    }
    // A recording was moved back, or so far ahead that the old line is out of view.
    if (at < last || at - last > KEPT_S) this.clear();
    // No line is drawn across a gap.
    else if (at - last > GAP_S) {
      times.push(at);
      values.push(null);
    }
    times.push(at);
    values.push(value);
    let old = 0;
    while (times[old] < at - KEPT_S) old += 1;
    if (old > 0) {
      times.splice(0, old);
      values.splice(0, old);
    }
  }

  // Returns the upper end of the scale: one, two or five times a power of ten.
  most() {
    const highest = this.values.reduce((most, value) => Math.max(most, value ?? 0), Math.max(this.least, this.limit ?? 0));
    const power = 10 ** Math.floor(Math.log10(highest));
    return [1, 2, 5, 10].map((n) => n * power).find((end) => end >= highest);
  }

  draw() {
    const { canvas, times, values, limit } = this;
    const scale = window.devicePixelRatio || 1;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    if (width === 0) return;
    if (canvas.width !== Math.round(width * scale)) canvas.width = Math.round(width * scale);
    if (canvas.height !== Math.round(height * scale)) canvas.height = Math.round(height * scale);
    const pen = canvas.getContext("2d"), style = getComputedStyle(canvas), colour = (name) => style.getPropertyValue(name).trim();
    pen.setTransform(scale, 0, 0, scale, 0, 0);
    pen.clearRect(0, 0, width, height);
    const most = this.most(), right = width - ROOM.right, bottom = height - ROOM.bottom;
    const x = (at) => right * (1 - (times.at(-1) - at) / KEPT_S), y = (value) => bottom - (bottom - ROOM.top) * Math.min(1, Math.max(0, value / most));
    this.axes(pen, colour, { most, right, bottom, width });
    if (limit !== null) {
      pen.strokeStyle = pen.fillStyle = colour("--warn");
      pen.setLineDash([3, 3]);
      line(pen, 0, y(limit), right, y(limit));
      pen.setLineDash([]);
      if (Math.abs(y(limit) - ROOM.top) > 11 && bottom - y(limit) > 9) pen.fillText(limit.toFixed(0), right + 4, y(limit));
    }
    pen.strokeStyle = colour("--line-data");
    pen.lineWidth = 1.5;
    pen.lineJoin = "round";
    pen.beginPath();
    let drawing = false;
    values.forEach((value, n) => {
      if (value === null) { drawing = false; return; }
      if (drawing) pen.lineTo(x(times[n]), y(value)); else pen.moveTo(x(times[n]), y(value));
      drawing = true;
    });
    pen.stroke();
    this.dot(pen, colour, right, y);
  }

  // Draws the newest value, even if no line leads to it yet.
  dot(pen, colour, x, y) {
    const value = this.values.at(-1) ?? null;
    if (value === null) return;
    pen.fillStyle = colour("--line-data");
    pen.beginPath();
    pen.arc(x, y(value), DOT_PX, 0, 2 * Math.PI);
    pen.fill();
  }

  axes(pen, colour, { most, right, bottom, width }) {
    pen.font = "10px system-ui, sans-serif";
    pen.textBaseline = "middle";
    pen.lineWidth = 1;
    pen.strokeStyle = colour("--line");
    line(pen, 0, Math.round(bottom) + 0.5, right, Math.round(bottom) + 0.5);
    line(pen, 0, ROOM.top + 0.5, right, ROOM.top + 0.5);
    pen.fillStyle = colour("--dim");
    pen.fillText(most.toLocaleString("en"), right + 4, ROOM.top + 3);
    pen.fillText("0", right + 4, bottom - 1);
    pen.fillText(`${KEPT_S} s ago`, 0, bottom + 8);
    pen.textAlign = "right";
    pen.fillText("now", right, bottom + 8);
    pen.textAlign = "left";
  }
}

function line(pen, x, y, toX, toY) {
  pen.beginPath();
  pen.moveTo(x, y);
  pen.lineTo(toX, toY);
  pen.stroke();
}
