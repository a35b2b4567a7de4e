/** Drawings as files. */

import { fileName, save } from '../chart/csv';
import type { Drawing } from './drawing';
import { toPdf } from './pdf';
import { toSvg } from './svg';

export function saveSvg(title: string, drawing: Drawing): void {
  save(fileName(title, 'svg'), new Blob([toSvg(drawing)], { type: 'image/svg+xml' }));
}

export function savePdf(title: string, drawing: Drawing): void {
  save(fileName(title, 'pdf'), new Blob([toPdf(drawing)], { type: 'application/pdf' }));
}

const PNG_SCALE = 2;

/** Through the browser's own reading of the SVG. */
export async function savePng(title: string, drawing: Drawing): Promise<void> {
  const url = URL.createObjectURL(new Blob([toSvg(drawing)], { type: 'image/svg+xml' }));
  try {
    const image = new Image();
    image.src = url;
    await image.decode();
    const canvas = document.createElement('canvas');
    canvas.width = drawing.width * PNG_SCALE;
    canvas.height = drawing.height * PNG_SCALE;
    canvas.getContext('2d')?.drawImage(image, 0, 0, canvas.width, canvas.height);
    const png = await new Promise<Blob | null>((done) => canvas.toBlob(done, 'image/png'));
    if (!png) throw new Error('the browser made no picture');
    save(fileName(title, 'png'), png);
  } finally {
    URL.revokeObjectURL(url);
  }
}
