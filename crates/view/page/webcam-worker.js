// Finds the person in images, beside the page's own thread: a stop never waits for it. The files come from this server,
// below an address with the token.

let landmarker = null, before = 0;

async function load(base) {
  const { FilesetResolver, PoseLandmarker } = await import(`${base}/vision_bundle.mjs`);
  const files = await FilesetResolver.forVisionTasks(`${base}/wasm`, true);
  const options = { baseOptions: { modelAssetPath: `${base}/model.task` }, runningMode: "VIDEO", numPoses: 1 };
  landmarker = await PoseLandmarker.createFromOptions(files, options);
}

// Answers with the landmarks in the image and in the world, and the image's breadth in its heights. Landmarks are null if
// nobody is there.
function look(image, at) {
  // The landmarker wants times that grow.
  before = Math.max(before + 1, Math.round(at));
  const found = landmarker.detectForVideo(image, before);
  const numbers = (marks) => marks?.map(({ x, y, z, visibility }) => [x, y, z, visibility ?? 0]) ?? null;
  const wide = (image.displayWidth ?? image.width) / (image.displayHeight ?? image.height);
  return { wide, inImage: numbers(found.landmarks[0]), inWorld: numbers(found.worldLandmarks[0]) };
}

onmessage = async ({ data: { base, image, at } }) => {
  try {
    if (base) {
      await load(base);
      postMessage({ ready: true });
    } else {
      postMessage({ at, ...look(image, at) });
    }
  } catch (error) {
    // The library adds where in its sources it failed.
    postMessage({ failed: (error?.message ?? String(error)).split("\n")[0] });
  } finally {
    image?.close();
  }
};
