import { readFileSync } from 'node:fs';
import fc from 'fast-check';
import { expect, test } from 'vitest';
import { debiasedEma, overSeeds } from './statistics';

const values = fc.array(fc.double({ min: -1e6, max: 1e6, noNaN: true }), { minLength: 1 });
const weight = fc.double({ min: 0.01, max: 0.98, noNaN: true });

test('the average is the weighted mean of what came before', () => {
  fc.assert(
    fc.property(values, weight, (all, share) => {
      const smooth = debiasedEma(all, share);
      all.forEach((_, at) => {
        const weights = all.slice(0, at + 1).map((_, i) => share ** (at - i));
        const total = weights.reduce((sum, one) => sum + one, 0);
        const mean = weights.reduce((sum, one, i) => sum + (one * all[i]!) / total, 0);
        expect(smooth[at]).toBeCloseTo(mean, 4);
      });
    }),
  );
});

test('missing values stay missing and change nothing', () => {
  expect(debiasedEma([null, 3, null, 3, NaN], 0.9)).toEqual([
    null,
    expect.closeTo(3, 12),
    null,
    expect.closeTo(3, 12),
    null,
  ]);
  const raw = [1, null, 2];
  expect(debiasedEma(raw, 0)).toBe(raw);
});

interface Vector {
  name: string;
  samples: { seed: number; value: number }[];
  expected: { runs: number; seeds: number; mean: number; std: number | null };
}
const file = new URL('../../../../../tests/vectors/statistics.json', import.meta.url);
const vectors = JSON.parse(readFileSync(file, 'utf8')) as Vector[];

test.each(vectors)('as every language computes it: $name', ({ samples, expected }) => {
  const { mean, std } = expected;
  expect(overSeeds(samples)).toEqual({
    ...expected,
    mean: expect.closeTo(mean, 6),
    std: std === null ? null : expect.closeTo(std, 6),
  });
});

test('of nothing there is no figure', () => {
  expect(overSeeds([])).toEqual({ runs: 0, seeds: 0, mean: null, std: null });
});
