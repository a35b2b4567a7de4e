/** Mean and spread over seeds, and smoothing of one line for the eye, which never changes what is compared. */

import type { Column } from './api/types';
import { plural } from './format';

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

/** What a value came to over seeds: the sample size is the number of seeds, not of runs. */
export interface Spread {
  runs: number;
  seeds: number;
  mean: number | null;
  /** The sample's standard deviation (n - 1); null of fewer than two seeds. */
  std: number | null;
}

/**
 * Mean and spread over seeds, as `bpn_shared/runs/statistics.py` defines them: runs of one seed are one sample however
 * often they were made, so they are averaged first.
 */
export function overSeeds(samples: readonly { seed: number; value: number }[]): Spread {
  const bySeed = new Map<number, number[]>();
  for (const { seed, value } of samples) {
    const known = bySeed.get(seed);
    if (known) known.push(value);
    else bySeed.set(seed, [value]);
  }
  const values = [...bySeed.values()].map(meanOf);
  const seeds = values.length;
  if (seeds === 0) return { runs: 0, seeds, mean: null, std: null };
  const mean = meanOf(values);
  const squares = values.reduce((sum, value) => sum + (value - mean) ** 2, 0);
  const std = seeds > 1 ? Math.sqrt(squares / (seeds - 1)) : null;
  return { runs: samples.length, seeds, mean, std };
}

/** How many runs, and of how many seeds where these are fewer: "14 runs, 3 seeds". */
export function countOf(runs: number, seeds: number): string {
  return seeds < runs ? `${plural(runs, 'run')}, ${plural(seeds, 'seed')}` : plural(runs, 'run');
}

function meanOf(values: readonly number[]): number {
  return values.reduce((sum, value) => sum + value, 0) / values.length;
}
