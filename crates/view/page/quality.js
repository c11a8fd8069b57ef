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
// Smallest share of the pixels along each side.
const LEAST = 0.5;
const STEP = 0.85;

// Pixel share of software rendering: fewer pixels if pictures are slow. A graphics card always draws all.
export class Sharpness {
  constructor(isFixed) {
    [this.isFixed, this.share] = [isFixed, 1];
    this.reset();
  }

  reset() { [this.sum, this.count] = [0, 0]; }

  // Records the time of a picture, s. Returns true if the share changed.
  note(time) {
    this.sum += time;
    this.count += 1;
    if (this.isFixed || this.count < AVERAGED) return false;
    const isSlow = this.sum > SLOW_S * this.count && this.share > LEAST;
    this.reset();
    if (isSlow) this.share = Math.max(LEAST, this.share * STEP);
    return isSlow;
  }
}
