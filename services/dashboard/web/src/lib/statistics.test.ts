import fc from 'fast-check';
import { expect, test } from 'vitest';
import { debiasedEma, meanAndStd } from './statistics';

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

test('mean and sample standard deviation', () => {
  expect(meanAndStd([2, 4, 4, 4, 5, 5, 7, 9])).toEqual({
    n: 8,
    mean: 5,
    std: expect.closeTo(Math.sqrt(32 / 7), 12),
  });
  expect(meanAndStd([3])).toEqual({ n: 1, mean: 3, std: null });
  expect(meanAndStd([])).toEqual({ n: 0, mean: null, std: null });
});
