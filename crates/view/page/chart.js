// Small charts of the last ten seconds.

const KEPT = 600;

export class Chart {
  // The scale grows with what is drawn, and never below `least`.
  constructor(canvas, least) {
    this.canvas = canvas;
    this.least = least;
    this.values = [];
  }

  add(value) {
    this.values.push(value);
    if (this.values.length > KEPT) this.values.shift();
  }

  draw() {
    const { canvas, values } = this;
    const scale = window.devicePixelRatio || 1;
    const width = Math.round(canvas.clientWidth * scale), height = Math.round(canvas.clientHeight * scale);
    if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
    const pen = canvas.getContext("2d");
    pen.clearRect(0, 0, width, height);
    const known = values.filter((value) => value !== null);
    if (known.length === 0) return;
    const most = Math.max(this.least, ...known);
    pen.strokeStyle = getComputedStyle(canvas).getPropertyValue("--measured");
    pen.lineWidth = scale;
    pen.beginPath();
    let drawing = false;
    values.forEach((value, n) => {
      if (value === null) { drawing = false; return; }
      const x = width * (n + KEPT - values.length) / KEPT, y = height - (height - scale) * Math.max(value, 0) / most - scale / 2;
      if (drawing) pen.lineTo(x, y); else pen.moveTo(x, y);
      drawing = true;
    });
    pen.stroke();
  }
}
