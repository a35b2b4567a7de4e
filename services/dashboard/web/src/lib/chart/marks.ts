/** Places on a chart's x that are worth a line: where a run was resumed. */

import type { Series } from '../api/types';

export interface Mark {
  x: number;
  text: string;
}

/** From the series of a run's attempts, wherever one begins but the first. */
export function resumptions(attempts: Pick<Series, 'x' | 'min' | 'max'> | undefined): Mark[] {
  if (!attempts) return [];
  const marks: Mark[] = [];
  let before: number | null = null;
  attempts.x.forEach((x, i) => {
    const [first, last] = [attempts.min[i] ?? null, attempts.max[i] ?? null];
    if (x === null || first === null || last === null) return;
    // Of a bucket in which one begins, the begin is near enough.
    if (before !== null && last > before) marks.push({ x, text: `attempt ${last}` });
    else if (before === null && last > first) marks.push({ x, text: `attempt ${last}` });
    before = last;
  });
  return marks;
}

/** Draws them over a chart, within the box that its axes leave. */
export function drawMarks(
  context: CanvasRenderingContext2D,
  marks: readonly Mark[],
  at: (x: number) => number,
  box: { left: number; top: number; width: number; height: number },
  style: { colour: string; font: string; scale: number },
): void {
  context.save();
  context.beginPath();
  context.rect(box.left, box.top, box.width, box.height);
  context.clip();
  context.strokeStyle = context.fillStyle = style.colour;
  context.lineWidth = style.scale;
  context.font = style.font;
  context.textBaseline = 'top';
  context.textAlign = 'left';
  let free = -Infinity;
  for (const { x, text } of marks) {
    const left = Math.round(at(x)) + 0.5;
    if (left < box.left || left > box.left + box.width) continue;
    context.setLineDash([3 * style.scale, 3 * style.scale]);
    context.beginPath();
    context.moveTo(left, box.top);
    context.lineTo(left, box.top + box.height);
    context.stroke();
    const width = context.measureText(text).width + 3 * style.scale;
    const fits = left + width <= box.left + box.width;
    const begin = fits ? left + 3 * style.scale : left - width; // at the end, before its line
    if (begin < free) continue;
    context.fillText(text, begin, box.top);
    free = begin + width + 8 * style.scale;
  }
  context.restore();
}
