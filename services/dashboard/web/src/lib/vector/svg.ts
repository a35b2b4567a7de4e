/** A drawing as an SVG document. */

import type { Drawing, Mark } from './drawing';

export function toSvg({ width, height, background, marks }: Drawing): string {
  return [
    `<svg xmlns="http://www.w3.org/2000/svg" width="${px(width)}" height="${px(height)}" viewBox="0 0 ${px(width)} ${px(height)}" font-family="Helvetica, Arial, sans-serif">`,
    `<rect width="100%" height="100%" fill="${escaped(background)}"/>`,
    ...marks.map(element),
    '</svg>\n',
  ].join('\n');
}

/** The shape of a path, as its `d`. */
export function pathData(mark: Extract<Mark, { kind: 'path' }>): string {
  const [first, ...rest] = mark.points;
  if (!first) return '';
  const steps = rest.map(([x, y]) => `L${px(x)} ${px(y)}`).join('');
  return `M${px(first[0])} ${px(first[1])}${steps}${mark.closed ? 'Z' : ''}`;
}

function element(mark: Mark): string {
  const title = mark.title ? `<title>${escaped(mark.title)}</title>` : '';
  if (mark.kind === 'text') {
    const turned = mark.upright ? ` transform="rotate(-90 ${px(mark.x)} ${px(mark.y)})"` : '';
    const bold = mark.bold ? ' font-weight="600"' : '';
    return `<text x="${px(mark.x)}" y="${px(mark.y)}" font-size="${mark.size}" fill="${escaped(mark.fill)}" text-anchor="${mark.anchor ?? 'start'}"${bold}${turned}>${escaped(mark.text)}${title}</text>`;
  }
  const style = [
    `fill="${escaped(mark.fill ?? 'none')}"`,
    mark.stroke ? `stroke="${escaped(mark.stroke)}" stroke-width="${px(mark.width ?? 1)}"` : '',
    mark.stroke ? 'stroke-linejoin="round" stroke-linecap="round"' : '',
    mark.dash?.length ? `stroke-dasharray="${mark.dash.join(' ')}"` : '',
    mark.alpha !== undefined && mark.alpha < 1 ? `opacity="${mark.alpha}"` : '',
  ]
    .filter(Boolean)
    .join(' ');
  if (mark.kind === 'circle')
    return `<circle cx="${px(mark.x)}" cy="${px(mark.y)}" r="${px(mark.r)}" ${style}>${title}</circle>`;
  return `<path d="${pathData(mark)}" ${style}>${title}</path>`;
}

function px(value: number): string {
  return String(Math.round(value * 100) / 100);
}

const ENTITIES: Record<string, string> = {
  '&': '&amp;',
  '<': '&lt;',
  '>': '&gt;',
  '"': '&quot;',
};

function escaped(text: string): string {
  return text
    .replace(/[\u0000-\u0008\u000b\u000c\u000e-\u001f\ufffe\uffff]/g, '')
    .replace(/[&<>"]/g, (one) => ENTITIES[one] ?? one);
}
