/** Smoothing of one line for the eye; it never changes what is aggregated, exported or compared. */

import type { Column } from './api/types';

/**
 * Exponential moving average without the bias to its start (as Adam corrects its moments).
 *
 * Missing values stay missing and change nothing.
 * @param weight - share of the past in each step, 0 (none) to below 1.
 */
export function debiasedEma(values: Column, weight: number): Column {
  if (weight <= 0) return values;
  let average = 0;
  let known = 0; // what a constant 1 would have come to: the correction
  return values.map((value) => {
    if (value === null || !Number.isFinite(value)) return null;
    average = weight * average + (1 - weight) * value;
    known = weight * known + (1 - weight);
    return average / known;
  });
}

/** Mean and sample standard deviation; the deviation of fewer than two is null. */
export function meanAndStd(values: number[]): {
  n: number;
  mean: number | null;
  std: number | null;
} {
  const n = values.length;
  if (n === 0) return { n, mean: null, std: null };
  const mean = values.reduce((sum, value) => sum + value, 0) / n;
  const squares = values.reduce((sum, value) => sum + (value - mean) ** 2, 0);
  return { n, mean, std: n > 1 ? Math.sqrt(squares / (n - 1)) : null };
}
