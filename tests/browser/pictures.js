// Functions over pictures, which are PNGs in base64. The tests evaluate them in the page.

async function pixels(picture) {
  const image = new Image();
  image.src = `data:image/png;base64,${picture}`;
  await image.decode();
  const pen = new OffscreenCanvas(image.width, image.height).getContext('2d');
  pen.drawImage(image, 0, 0);
  return pen.getImageData(0, 0, image.width, image.height);
}

// The number of pixels with about this colour, under any light.
async function countPixels(picture, near) {
  const { data } = await pixels(picture);
  const size = Math.hypot(...near);
  let count = 0;
  for (let i = 0; i < data.length; i += 4) {
    const own = Math.hypot(data[i], data[i + 1], data[i + 2]);
    const same = (data[i] * near[0] + data[i + 1] * near[1] + data[i + 2] * near[2]) / (own * size);
    if (own > 60 && same > 0.98) count += 1;
  }
  return count;
}

// The number of pixels that differ, the edges of the box around them, and their mean colour in the second picture.
async function difference(before, after) {
  const [a, b] = [await pixels(before), await pixels(after)];
  const box = [1e9, 1e9, -1, -1];
  const mean = [0, 0, 0];
  let count = 0;
  for (let i = 0; i < a.data.length; i += 4) {
    const off = [0, 1, 2].reduce((sum, k) => sum + Math.abs(a.data[i + k] - b.data[i + k]), 0);
    if (off < 24) continue;
    count += 1;
    const x = (i / 4) % a.width;
    const y = Math.floor(i / 4 / a.width);
    box[0] = Math.min(box[0], x);
    box[1] = Math.min(box[1], y);
    box[2] = Math.max(box[2], x);
    box[3] = Math.max(box[3], y);
    for (let k = 0; k < 3; k += 1) mean[k] += b.data[i + k];
  }
  return [count, ...box, ...mean.map((sum) => sum / Math.max(count, 1))];
}

// The number of pixels of a sparkline that have its own colour.
function countInked(name) {
  const canvas = document.querySelector(`[data-line=${name}]`);
  const own = getComputedStyle(canvas).getPropertyValue('--line-data').trim();
  const [r, g, b] = [1, 3, 5].map((n) => parseInt(own.slice(n, n + 2), 16));
  const { data } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
  let count = 0;
  for (let i = 0; i < data.length; i += 4) {
    const off = Math.abs(data[i] - r) + Math.abs(data[i + 1] - g) + Math.abs(data[i + 2] - b);
    if (data[i + 3] > 200 && off < 12) count += 1;
  }
  return count;
}
