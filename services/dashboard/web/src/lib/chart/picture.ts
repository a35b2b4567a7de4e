/** A chart as an image that can stand on its own: with title, legend and background. */

export interface Caption {
  title: string;
  entries: readonly { label: string; colour: string }[];
  background: string;
  text: string;
  font: string;
}

const LINE_PX = 22;
const PAD_PX = 12;

/** Draws the chart's canvas below its title and above its legend. */
export function picture(chart: HTMLCanvasElement, caption: Caption): Promise<Blob | null> {
  const scale = chart.width / Math.max(1, chart.clientWidth);
  const canvas = document.createElement('canvas');
  const context = canvas.getContext('2d');
  if (!context) return Promise.resolve(null);
  const font = `${12 * scale}px ${caption.font}`;
  context.font = font;
  const [line, pad, swatch] = [LINE_PX * scale, PAD_PX * scale, 16 * scale];

  const placed: { label: string; colour: string; x: number; row: number }[] = [];
  let x = pad;
  let row = 0;
  for (const { label, colour } of caption.entries) {
    const width = swatch + context.measureText(label).width + 3 * pad;
    if (x > pad && x + width > chart.width) {
      x = pad;
      row += 1;
    }
    placed.push({ label, colour, x, row });
    x += width;
  }

  canvas.width = chart.width;
  canvas.height = line + pad + chart.height + (row + 1) * line + pad;
  context.fillStyle = caption.background;
  context.fillRect(0, 0, canvas.width, canvas.height);
  context.drawImage(chart, 0, line + pad);
  context.textBaseline = 'middle';
  context.fillStyle = caption.text;
  context.font = `600 ${13 * scale}px ${caption.font}`;
  context.fillText(caption.title, pad, pad + line / 2);
  context.font = font;
  for (const entry of placed) {
    const y = line + pad + chart.height + (entry.row + 0.5) * line;
    context.fillStyle = entry.colour;
    context.fillRect(entry.x, y - scale, swatch, 2.5 * scale);
    context.fillStyle = caption.text;
    context.fillText(entry.label, entry.x + swatch + pad / 2, y);
  }
  return new Promise((done) => canvas.toBlob(done, 'image/png'));
}
