// Level of detail. A graphics card smooths edges and casts real shadows. Software rendering draws less.

// Driver names that indicate software rendering.
const SOFTWARE = /swiftshader|llvmpipe|softpipe|software|basic render/i;

// `asked` is high or low. Anything else selects the best that this machine can do.
export function isHigh(asked) {
  if (asked === "high" || asked === "low") return asked === "high";
  const gl = new OffscreenCanvas(1, 1).getContext("webgl2");
  const about = gl?.getExtension("WEBGL_debug_renderer_info");
  const name = gl?.getParameter(about ? about.UNMASKED_RENDERER_WEBGL : gl.RENDERER) ?? "";
  gl?.getExtension("WEBGL_lose_context")?.loseContext();
  return !SOFTWARE.test(name);
}

// Number of pictures averaged before the pixel count changes.
const AVERAGED = 15;
// Slowest smooth picture, s. 30 a second are smooth, and the display's own rate varies slightly.
const SLOW_S = 1 / 31;
// A picture that takes less than this is quick, s: with a step more pixels, 1.38 times as many, it takes about 1 / 29.
const QUICK_S = 1 / 40;
// Smallest share of the pixels along each side.
const LEAST = 0.5;
const STEP = 0.85;
// The number of pixels rises after this many averages that were all quick: 5 s at 60 pictures a second.
const WAIT = 20;
// A rise that is taken back doubles the wait, up to this: 5 minutes.
const LONGEST_WAIT = 64 * WAIT;

// Pixel share of software rendering: fewer pixels while pictures are slow, and slowly more again when they are quick.
// A graphics card always draws all.
export class Sharpness {
  constructor(isFixed) {
    [this.isFixed, this.share] = [isFixed, 1];
    // Averages since the last change, of which the newest `quick` were quick. A rise is on trial for as long as it waited.
    [this.wait, this.calm, this.quick, this.isTrial] = [WAIT, 0, 0, false];
    this.reset();
  }

  reset() { [this.sum, this.count] = [0, 0]; }

  // Records the time of a picture, s. Returns true if the share changed.
  note(time) {
    this.sum += time;
    this.count += 1;
    if (this.isFixed || this.count < AVERAGED) return false;
    const mean = this.sum / this.count, before = this.share;
    this.reset();
    if (mean > SLOW_S) this.fall();
    else this.rest(mean < QUICK_S);
    return this.share !== before;
  }

  fall() {
    if (this.isTrial) this.wait = Math.min(LONGEST_WAIT, this.wait * 2);
    this.change(this.share * STEP, false);
  }

  rest(isQuick) {
    this.calm += 1;
    this.quick = isQuick ? this.quick + 1 : 0;
    if (this.isTrial && this.calm >= this.wait) [this.wait, this.isTrial] = [WAIT, false];
    if (this.quick >= this.wait && this.share < 1) this.change(this.share / STEP, true);
  }

  change(share, isTrial) {
    this.share = Math.min(1, Math.max(LEAST, share));
    [this.calm, this.quick, this.isTrial] = [0, 0, isTrial];
  }
}
