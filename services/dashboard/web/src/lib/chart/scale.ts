/** How a chart's y is shown: linear or logarithmic, with outliers or without, all of it or a part that somebody chose. */

import type { Column } from '../api/types';
import { rangeOfValues, type Range } from './range';

export interface YScale {
  logarithmic: boolean;
  /** Leave values far from all others out of what is shown. */
  clipped: boolean;
  /** Chosen by hand; null: as the values are. */
  range: Range | null;
}

/** 'log' where all values are above 0; else symmetric: linear near 0, logarithmic on both sides of it. */
export type Distribution = 'linear' | 'log' | 'symlog';

const SPAN = /^(-?[\d.]+(?:e[+-]?\d+)?)\.\.(-?[\d.]+(?:e[+-]?\d+)?)$/i;
/** Tukey's outer fences: what lies so many interquartile ranges outside the quartiles is far out. */
const FENCE = 3;
const DECADES = 3; // of a symmetric logarithmic scale, on either side

/** A scale as a link has it: "log", "clip", "-400..0", together. What is not said is as the page has it. */
export function parseScale(items: readonly string[], logarithmic: boolean): YScale {
  const scale: YScale = { logarithmic, clipped: items.includes('clip'), range: null };
  for (const item of items) {
    if (item === 'log' || item === 'linear') scale.logarithmic = item === 'log';
    const [, low = NaN, high = NaN] = (SPAN.exec(item) ?? []).map(Number);
    if (low < high && Number.isFinite(low) && Number.isFinite(high)) scale.range = [low, high];
  }
  return scale;
}

export function scaleItems(scale: YScale, logarithmic: boolean): string[] {
  return [
    ...(scale.logarithmic === logarithmic ? [] : [scale.logarithmic ? 'log' : 'linear']),
    ...(scale.clipped ? ['clip'] : []),
    ...(scale.range ? [`${scale.range[0]}..${scale.range[1]}`] : []),
  ];
}

function numbers(columns: readonly Column[]): number[] {
  return columns.flatMap((column) =>
    column.filter((value): value is number => value !== null && Number.isFinite(value)),
  );
}

export function distributionOf(scale: YScale, columns: readonly Column[]): Distribution {
  if (!scale.logarithmic) return 'linear';
  const [low] = scale.range ?? [Infinity];
  return low > 0 && numbers(columns).every((value) => value > 0) ? 'log' : 'symlog';
}

/** Up to where a symmetric logarithmic scale is linear. */
export function linearUpTo(columns: readonly Column[]): number {
  let largest = 0;
  for (const value of numbers(columns)) largest = Math.max(largest, Math.abs(value));
  return largest > 0 ? 10 ** (Math.floor(Math.log10(largest)) - DECADES + 1) : 1;
}

/** Lowest and highest value that is not far out; null where there are none. */
export function withoutOutliers(columns: readonly Column[]): Range | null {
  const values = numbers(columns).sort((a, b) => a - b);
  if (values.length === 0) return null;
  const quartile = (share: number): number => values[Math.round(share * (values.length - 1))] ?? 0;
  const [lower, upper] = [quartile(0.25), quartile(0.75)];
  const reach = FENCE * (upper - lower || Math.abs(upper) || 1);
  const inside = values.filter((value) => value >= lower - reach && value <= upper + reach);
  return [inside[0] ?? lower, inside.at(-1) ?? upper];
}

/** What of y is shown: chosen, or with room around all values, or around those that are not far out. */
export function yRange(
  scale: YScale,
  columns: readonly Column[],
  low: number | null,
  high: number | null,
): ReturnType<typeof rangeOfValues> {
  if (scale.range) return [...scale.range];
  const inside = scale.clipped ? withoutOutliers(columns) : null;
  return inside ? rangeOfValues(...inside) : rangeOfValues(low, high);
}
