// The page's own worker, asked for the landmarks of pictures.

const worker = new Worker('webcam-worker.js', { type: 'module' });
const answer = (message, owned) =>
  new Promise((done) => {
    worker.onmessage = ({ data }) => done(data);
    worker.postMessage(message, owned);
  });

// The landmarks, m, in a PNG in base64, which was taken at a time in ms.
window.landmarks = async (picture, at) => {
  const drawn = new Image();
  drawn.src = `data:image/png;base64,${picture}`;
  await drawn.decode();
  const image = await createImageBitmap(drawn);
  const { inWorld, failed } = await answer({ image, at }, [image]);
  if (failed) throw new Error(failed);
  return inWorld?.map((mark) => mark.slice(0, 3)) ?? Array(33).fill([null, null, null]);
};

const { ready, failed } = await answer({ base: `/vision/${location.hash.slice(1)}` }, []);
if (!ready) throw new Error(failed);
