/** Camera pixels, channels first as the network gets them, to what a canvas draws. */

/** Pixels of one or more stacked frames, uint8[frames * c, height, width], oldest frame first. */
export interface Stack {
  pixels: Uint8Array<ArrayBufferLike>;
  channels: number;
  heightPx: number;
  widthPx: number;
  framesStacked: number;
}

/** RGBA of the `back`-th newest frame (0: the newest). Throws RangeError if there is none. */
export function frameToRgba(stack: Stack, back: number): Uint8ClampedArray<ArrayBuffer> {
  if (back < 0 || back >= stack.framesStacked) {
    throw new RangeError(`frame ${back} of a stack of ${stack.framesStacked}`);
  }
  const channels = stack.channels / stack.framesStacked;
  const area = stack.heightPx * stack.widthPx;
  const start = (stack.framesStacked - 1 - back) * channels * area;
  // Gray in one plane; with three or more, the first three are red, green, blue.
  const green = channels >= 3 ? start + area : start;
  const blue = channels >= 3 ? start + 2 * area : start;
  const { pixels } = stack;
  const rgba = new Uint8ClampedArray(4 * area);
  for (let i = 0, out = 0; i < area; i += 1, out += 4) {
    rgba[out] = pixels[start + i]!;
    rgba[out + 1] = pixels[green + i]!;
    rgba[out + 2] = pixels[blue + i]!;
    rgba[out + 3] = 255;
  }
  return rgba;
}
