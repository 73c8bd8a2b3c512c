// Planes of values as pictures.

export const INVALID = -32768;

const NONE = 0xff140f0c;
const HATCH = [0xff2a2521, 0xff5c534a];

let colours = new Uint32Array(256).fill(0xff808080);

// Fetches the colours of disparities, which are those of the files that `vgstereo match` writes.
export async function loadColours() {
  const bytes = new Uint8Array(await (await fetch("colours")).arrayBuffer());
  colours = Uint32Array.from({ length: 256 }, (_, i) => packed(bytes[3 * i], bytes[3 * i + 1], bytes[3 * i + 2]));
}

const packed = (red, green, blue) => (0xff000000 | (blue << 16) | (green << 8) | red) >>> 0;

// The colour of a value between two others, as a pixel.
export function colourOf(value, low, high) {
  const level = Math.round((255 * (value - low)) / (high - low || 1));
  return colours[Math.min(255, Math.max(0, level))];
}

export const grey = (level) => packed(level, level, level);

// Draws planes side by side. `pixel` gives the pixel of a value, or nothing where there is none. Missing
// lines are hatched, so that they are not taken for values.
export function drawPlanes(canvas, planes, pixel) {
  const width = planes.reduce((sum, plane) => sum + plane.width, 0);
  const height = Math.max(...planes.map((plane) => plane.height));
  if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
  const image = new ImageData(width, height);
  const pixels = new Uint32Array(image.data.buffer);
  let left = 0;
  for (const plane of planes) {
    const { values, channels } = plane;
    for (let y = 0, from = 0; y < plane.height; y++) {
      for (let x = 0, to = y * width + left; x < plane.width; x++, to++, from += channels) {
        pixels[to] =
          channels === 3
            ? packed(values[from], values[from + 1], values[from + 2])
            : (pixel(values[from]) ?? NONE);
      }
    }
    for (const [first, count] of plane.missing) {
      for (let y = first; y < first + count; y++) {
        for (let x = 0; x < plane.width; x++) pixels[y * width + left + x] = HATCH[((x + y) >> 2) & 1];
      }
    }
    left += plane.width;
  }
  canvas.getContext("2d").putImageData(image, 0, 0);
}

// Draws the colours of a legend, from those of `low` to those of `high`.
export function drawLegend(canvas, low, high) {
  const image = new ImageData(canvas.width, 1);
  const pixels = new Uint32Array(image.data.buffer);
  for (let x = 0; x < canvas.width; x++) {
    pixels[x] = colourOf(low + ((high - low) * x) / (canvas.width - 1), Math.min(low, high), Math.max(low, high));
  }
  canvas.getContext("2d").putImageData(image, 0, 0);
}

// Whether a line of a plane has not come.
export function isMissing(plane, row) {
  return plane.missing.some(([first, count]) => row >= first && row < first + count);
}

// The value of a plane at a pixel of the frame; `undefined` beyond it and where its line is missing.
export function valueAt(plane, x, y) {
  if (!plane) return undefined;
  const column = x - plane.x;
  const row = y - plane.y;
  if (column < 0 || row < 0 || column >= plane.width || row >= plane.height || isMissing(plane, row)) return undefined;
  return plane.values[row * plane.width + column];
}
