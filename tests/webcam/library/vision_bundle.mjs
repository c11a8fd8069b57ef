// A stand-in for MediaPipe's library. It finds no person in the image: its person waves the left arm by the clock, and
// trembles as real landmarks do. It checks that the page calls it as it would call the real one.

export class FilesetResolver {
  static async forVisionTasks(base, useModule) {
    const stem = `${base}/vision_wasm${useModule ? "_module" : ""}_internal`;
    return { wasmLoaderPath: `${stem}.js`, wasmBinaryPath: `${stem}.wasm` };
  }
}

// World landmarks of a person in a T-pose whose left arm is raised by `angle`, rad.
function person(angle, at) {
  const marks = Array.from({ length: 33 }, () => [0, 0, 0]);
  marks[0] = [0, -0.65, -0.1];
  for (const n of [1, 2, 3, 4, 5, 6, 9, 10]) marks[n] = [[1, 2, 3, 9].includes(n) ? 0.03 : -0.03, -0.66, -0.09];
  for (const [side, first] of [[1, 0], [-1, 1]]) {
    const reach = side === 1 ? [Math.cos(angle), -Math.sin(angle), 0] : [-1, 0, 0];
    const along = (n, length) => { marks[n + first] = marks[11 + first].map((x, axis) => x + length * reach[axis]); };
    marks[7 + first] = [0.08 * side, -0.65, 0];
    marks[11 + first] = [0.18 * side, -0.45, 0];
    along(13, 0.28);
    along(15, 0.53);
    for (const n of [17, 19, 21]) along(n, 0.6);
    marks[23 + first] = [0.1 * side, 0, 0];
    marks[25 + first] = [0.1 * side, 0.42, 0];
    marks[27 + first] = [0.1 * side, 0.85, 0];
    marks[29 + first] = [0.1 * side, 0.9, 0.05];
    marks[31 + first] = [0.1 * side, 0.92, -0.12];
  }
  return marks.map((mark, n) => mark.map((x, axis) => x + 2e-4 * Math.sin(0.7 * at + 3 * n + axis)));
}

export class PoseLandmarker {
  static async createFromOptions(files, { baseOptions: { modelAssetPath }, runningMode, numPoses }) {
    if (runningMode !== "VIDEO" || numPoses !== 1) throw new Error(`${runningMode}, ${numPoses}`);
    for (const path of [files.wasmLoaderPath, files.wasmBinaryPath, modelAssetPath]) {
      const answer = await fetch(path);
      if (!answer.ok) throw new Error(`${path}: ${answer.status}`);
    }
    // The policy of the page, and not a missing network, keeps requests in the machine.
    const refused = new Promise((resolve) => { self.addEventListener("securitypolicyviolation", resolve, { once: true }); });
    await fetch("https://example.com/").then(() => { throw new Error("a request left the machine"); }, () => refused);
    return new PoseLandmarker();
  }

  detectForVideo(image, at) {
    if (!((image.displayWidth ?? image.width) > 0) || !(at > (this.before ?? 0))) throw new Error("no image, or an old one");
    this.before = at;
    const world = person(1.2 * Math.sin(at / 1500), at);
    const mark = ([x, y, z], visibility) => ({ x, y, z, visibility });
    const place = ([x, y, z]) => mark([0.5 + x / 2.4, 0.5 + y / 2.4, z], 0.9);
    return { landmarks: [world.map(place)], worldLandmarks: [world.map((m) => mark(m, 0.9))] };
  }
}
