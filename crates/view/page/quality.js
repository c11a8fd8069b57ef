// How much is drawn: a graphics card smooths edges and casts real shadows, a processor that draws must do with less.

// Names by which drivers say that the processor draws.
const SOFTWARE = /swiftshader|llvmpipe|softpipe|software|basic render/i;

// `asked` is high, low, or anything else for what this machine can do.
export function isHigh(asked) {
  if (asked === "high" || asked === "low") return asked === "high";
  const gl = new OffscreenCanvas(1, 1).getContext("webgl2");
  const about = gl?.getExtension("WEBGL_debug_renderer_info");
  const name = gl?.getParameter(about ? about.UNMASKED_RENDERER_WEBGL : gl.RENDERER) ?? "";
  gl?.getExtension("WEBGL_lose_context")?.loseContext();
  return !SOFTWARE.test(name);
}

// Pictures whose times are averaged before the number of pixels changes.
const AVERAGED = 15;
// A picture that takes longer than this is slow, s: 30 a second are smooth, and a display's own rhythm trembles.
const SLOW_S = 1 / 31;
// Pixels along each side are never fewer than this share.
const LEAST = 0.5;
const STEP = 0.85;

// How sharp a processor draws: with fewer pixels where pictures are slow. A graphics card always draws all.
export class Sharpness {
  constructor(isFixed) {
    [this.isFixed, this.share] = [isFixed, 1];
    this.reset();
  }

  reset() { [this.sum, this.count] = [0, 0]; }

  // Takes the time of a picture, s. Says whether the share changed.
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
