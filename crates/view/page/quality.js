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
