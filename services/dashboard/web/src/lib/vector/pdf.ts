/**
 * A drawing as a PDF of one page, in points: vectors and Helvetica, which every reader has, so that nothing is embedded.
 *
 * Helvetica's encoding is WinAnsi: a character that it lacks is spelled out where it has a name, else it is "?".
 */

import type { Drawing, Mark } from './drawing';

const SPELLED: Record<string, string> = {
  '\u2212': '-',
  '\u202f': ' ',
  '\u2009': ' ',
  λ: 'lambda',
  ε: 'epsilon',
  α: 'alpha',
  β: 'beta',
  γ: 'gamma',
  '≥': '>=',
  '≤': '<=',
  '≈': '~',
  '→': '->',
};
const ABOVE_LATIN: Record<string, number> = {
  '€': 128, '…': 133, '‘': 145, '’': 146, '“': 147, '”': 148, '•': 149, '–': 150, '—': 151,
}; // prettier-ignore

/* Widths of Helvetica's characters from the space to the tilde, in thousandths of the size (Adobe's metrics). */
const WIDTHS = [
  278, 278, 355, 556, 556, 889, 667, 191, 333, 333, 389, 584, 278, 333, 278, 278, 556, 556, 556,
  556, 556, 556, 556, 556, 556, 556, 278, 278, 584, 584, 584, 556, 1015, 667, 667, 722, 722, 667,
  611, 778, 722, 278, 500, 667, 556, 833, 722, 778, 667, 778, 722, 667, 611, 722, 667, 944, 667,
  667, 611, 278, 278, 278, 469, 556, 333, 556, 556, 500, 556, 556, 278, 556, 556, 222, 222, 500,
  222, 833, 556, 556, 556, 556, 333, 500, 278, 556, 500, 722, 500, 500, 500, 334, 260, 334, 584,
];
const USUAL_WIDTH = 556;
const PT_PER_PX = 0.75;

export function toPdf(drawing: Drawing): Uint8Array<ArrayBuffer> {
  const alphas = [...new Set(drawing.marks.map(alphaOf))];
  const page = [
    `${PT_PER_PX} 0 0 ${-PT_PER_PX} 0 ${number(drawing.height * PT_PER_PX)} cm 1 j 1 J`,
    `${colour(drawing.background)} rg 0 0 ${number(drawing.width)} ${number(drawing.height)} re f`,
    ...drawing.marks.map((mark) => `/A${alphas.indexOf(alphaOf(mark))} gs ${content(mark)}`),
  ].join('\n');
  const states = alphas.map((alpha, i) => `/A${i} << /ca ${alpha} /CA ${alpha} >>`).join(' ');
  const box = `[0 0 ${number(drawing.width * PT_PER_PX)} ${number(drawing.height * PT_PER_PX)}]`;
  return file([
    '<< /Type /Catalog /Pages 2 0 R >>',
    '<< /Type /Pages /Kids [3 0 R] /Count 1 >>',
    `<< /Type /Page /Parent 2 0 R /MediaBox ${box} /Contents 4 0 R /Resources << /Font << /F0 5 0 R /F1 6 0 R >> /ExtGState << ${states} >> >> >>`,
    `<< /Length ${page.length} >>\nstream\n${page}\nendstream`,
    font('Helvetica'),
    font('Helvetica-Bold'),
  ]);
}

function alphaOf(mark: Mark): number {
  return mark.kind === 'text' ? 1 : (mark.alpha ?? 1);
}

function font(name: string): string {
  return `<< /Type /Font /Subtype /Type1 /BaseFont /${name} /Encoding /WinAnsiEncoding >>`;
}

/** Objects with the table of where each begins. Every character is one byte. */
function file(objects: readonly string[]): Uint8Array<ArrayBuffer> {
  let text = '%PDF-1.4\n';
  const begins = objects.map((object, i) => {
    const at = text.length;
    text += `${i + 1} 0 obj\n${object}\nendobj\n`;
    return at;
  });
  const entries = begins.map((at) => `${String(at).padStart(10, '0')} 00000 n \n`).join('');
  const size = objects.length + 1;
  text += `xref\n0 ${size}\n0000000000 65535 f \n${entries}trailer\n<< /Size ${size} /Root 1 0 R >>\nstartxref\n${text.length}\n%%EOF\n`;
  return Uint8Array.from(text, (one) => one.charCodeAt(0));
}

function content(mark: Mark): string {
  if (mark.kind === 'text') return textContent(mark);
  const paint = mark.fill ? (mark.stroke ? 'B' : 'f') : mark.stroke ? 'S' : 'n';
  const style = [
    mark.fill ? `${colour(mark.fill)} rg` : '',
    mark.stroke ? `${colour(mark.stroke)} RG ${number(mark.width ?? 1)} w` : '',
    `[${(mark.dash ?? []).join(' ')}] 0 d`,
  ];
  const shape = mark.kind === 'circle' ? circle(mark.x, mark.y, mark.r) : path(mark);
  return [...style, shape, paint].filter(Boolean).join(' ');
}

function path({ points, closed }: Extract<Mark, { kind: 'path' }>): string {
  const steps = points.map(([x, y], i) => `${number(x)} ${number(y)} ${i ? 'l' : 'm'}`);
  return steps.join(' ') + (closed ? ' h' : '');
}

const ARC = 0.5523; // of the radius: where a Bezier quarter has its handles

function circle(x: number, y: number, r: number): string {
  const k = r * ARC;
  const curve = (...values: number[]): string => `${values.map(number).join(' ')} c`;
  return [
    `${number(x + r)} ${number(y)} m`,
    curve(x + r, y + k, x + k, y + r, x, y + r),
    curve(x - k, y + r, x - r, y + k, x - r, y),
    curve(x - r, y - k, x - k, y - r, x, y - r),
    curve(x + k, y - r, x + r, y - k, x + r, y),
    'h',
  ].join(' ');
}

function textContent(mark: Extract<Mark, { kind: 'text' }>): string {
  const text = encoded(mark.text);
  const share = { start: 0, middle: 0.5, end: 1 }[mark.anchor ?? 'start'];
  const shift = share * textWidth(text, mark.size);
  const [x, y] = mark.upright ? [mark.x, mark.y + shift] : [mark.x - shift, mark.y];
  // The page is turned upside down so that y points down; letters are turned back.
  const turned = mark.upright ? '0 -1 -1 0' : '1 0 0 -1';
  const literal = text.replace(/[\\()]/g, '\\$&');
  return `BT /F${mark.bold ? 1 : 0} ${mark.size} Tf ${colour(mark.fill)} rg ${turned} ${number(x)} ${number(y)} Tm (${literal}) Tj ET`;
}

function encoded(text: string): string {
  return Array.from(text, (one) => {
    const spelled = SPELLED[one];
    if (spelled !== undefined) return spelled;
    const code = ABOVE_LATIN[one] ?? one.charCodeAt(0);
    const known =
      one.length === 1 &&
      (one in ABOVE_LATIN || (code >= 32 && code < 127) || (code >= 161 && code < 256));
    return known ? String.fromCharCode(code) : '?';
  }).join('');
}

function textWidth(text: string, size: number): number {
  const units = Array.from(text).reduce(
    (sum, one) => sum + (WIDTHS[one.charCodeAt(0) - 32] ?? USUAL_WIDTH),
    0,
  );
  return (units * size) / 1000;
}

function colour(hex: string): string {
  return [1, 3, 5].map((at) => number(parseInt(hex.slice(at, at + 2), 16) / 255 || 0)).join(' ');
}

function number(value: number): string {
  return String(Math.round(value * 1000) / 1000);
}
