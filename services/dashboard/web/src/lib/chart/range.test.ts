import fc from 'fast-check';
import { expect, test } from 'vitest';
import { rangeOfValues, widened } from './range';

const value = fc.integer({ min: -1_000_000, max: 1_000_000 });

test('values lie within what is shown of them', () => {
  fc.assert(
    fc.property(value, value, (one, other) => {
      const [low, high] = [Math.min(one, other), Math.max(one, other)];
      for (const [from, to] of [rangeOfValues(low, high), widened(low, high)]) {
        expect(from).toBeLessThanOrEqual(low);
        expect(to).toBeGreaterThanOrEqual(high);
        expect(to).toBeGreaterThan(from!);
      }
    }),
  );
});

test('zeros alone are shown up to one, which is 100 % of a share', () => {
  expect(rangeOfValues(0, 0)).toEqual([0, 1]);
});

test('a value that never changes is shown in its own size', () => {
  expect(rangeOfValues(20, 20)).toEqual([18, 22]);
  expect(rangeOfValues(-0.5, -0.5)).toEqual([-0.55, -0.45]);
});

test('without values there is nothing to show of y', () => {
  expect(rangeOfValues(null, null)).toEqual([null, null]);
});
