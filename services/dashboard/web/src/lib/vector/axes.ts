/** Scales from values to pixels, and the marks of their axes. */

import { number } from '../format';
import { label, line, type Ink, type Mark } from './drawing';

export interface Frame {
  left: number;
  top: number;
  right: number;
  bottom: number;
}

export interface Scale {
  (value: number): number;
  ticks: readonly number[];
}

const STEPS = [1, 2, 5, 10];

/** Even ticks, about so many, that lie in [low, high]. */
export function ticksOf(low: number, high: number, about: number): number[] {
  if (!(high > low) || !Number.isFinite(high - low)) return Number.isFinite(low) ? [low] : [];
  const raw = (high - low) / Math.max(1, about);
  const power = 10 ** Math.floor(Math.log10(raw));
  const step = (STEPS.find((one) => one * power >= raw) ?? 10) * power;
  const first = Math.ceil(low / step - 1e-9);
  const count = Math.floor(high / step + 1e-9) - first + 1;
  return Array.from({ length: Math.max(0, count) }, (_, i) => (first + i) * step);
}

/** From the values' range, with some room around it, to pixels from `from` to `to`. */
export function scaleOf(
  values: readonly number[],
  from: number,
  to: number,
  {
    about = 5,
    room = 0.05,
    range,
  }: { about?: number; room?: number; range?: [number, number] } = {},
): Scale {
  let [low, high] = range ?? [Infinity, -Infinity];
  if (!range) {
    for (const value of values) {
      if (value < low) low = value;
      if (value > high) high = value;
    }
    if (low > high) [low, high] = [0, 1];
    const more = high > low ? (high - low) * room : Math.abs(high) * 0.05 || 1;
    [low, high] = [low - more, high + more];
  }
  const scale = (value: number): number => from + ((value - low) / (high - low)) * (to - from);
  return Object.assign(scale, { ticks: ticksOf(low, high, about) });
}

/** Grid, numbers and titles along x (below) and y (to the left). */
export function axes(
  frame: Frame,
  x: Scale | null,
  y: Scale | null,
  ink: Ink,
  titles: { x?: string; y?: string } = {},
): Mark[] {
  const marks: Mark[] = [];
  for (const tick of x?.ticks ?? []) {
    const at = (x as Scale)(tick);
    marks.push(
      line([[at, frame.top], [at, frame.bottom]], ink.line),
      label(at, frame.bottom + 16, number(tick, 6), ink.muted, { anchor: 'middle' }),
    ); // prettier-ignore
  }
  for (const tick of y?.ticks ?? []) {
    const at = (y as Scale)(tick);
    marks.push(
      line([[frame.left, at], [frame.right, at]], ink.line),
      label(frame.left - 6, at + 4, number(tick, 6), ink.muted, { anchor: 'end' }),
    ); // prettier-ignore
  }
  if (titles.x)
    marks.push(
      label((frame.left + frame.right) / 2, frame.bottom + 34, titles.x, ink.muted, {
        anchor: 'middle',
      }),
    );
  if (titles.y)
    marks.push(
      label(14, (frame.top + frame.bottom) / 2, titles.y, ink.muted, {
        anchor: 'middle',
        upright: true,
      }),
    );
  return marks;
}
