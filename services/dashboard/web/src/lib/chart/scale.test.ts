import fc from 'fast-check';
import { expect, test } from 'vitest';
import {
  distributionOf,
  linearUpTo,
  parseScale,
  scaleItems,
  withoutOutliers,
  yRange,
  type YScale,
} from './scale';

const PLAIN: YScale = { logarithmic: false, clipped: false, range: null };
const LOG: YScale = { ...PLAIN, logarithmic: true };
const span = fc
  .tuple(
    fc.double({ noNaN: true, min: -1e12, max: 1e12 }),
    fc.double({ noNaN: true, min: 1e-3, max: 1e12 }),
  )
  .map(([low, width]): [number, number] => [low + 0, low + width])
  .filter(([low, high]) => low < high);

test('a scale survives its link, on pages that begin linear or logarithmic', () => {
  fc.assert(
    fc.property(fc.boolean(), fc.boolean(), fc.option(span), fc.boolean(), (...values) => {
      const [logarithmic, clipped, range, page] = values;
      const scale = { logarithmic, clipped, range };
      expect(parseScale(scaleItems(scale, page), page)).toEqual(scale);
    }),
  );
  expect(scaleItems(PLAIN, false)).toEqual([]);
  expect(parseScale(['nonsense', '9..1', '..', 'log..2'], false)).toEqual(PLAIN);
});

test('returns below zero have a logarithmic scale too', () => {
  expect(distributionOf(PLAIN, [[-5, -1]])).toBe('linear');
  expect(distributionOf(LOG, [[1, null, 1000]])).toBe('log');
  expect(distributionOf(LOG, [[-400, -1]])).toBe('symlog');
  expect(distributionOf(LOG, [[0, 5]])).toBe('symlog');
  expect(distributionOf({ ...LOG, range: [-1, 5] }, [[1, 5]])).toBe('symlog');
  expect(linearUpTo([[-400, 0, null]])).toBeCloseTo(1);
  expect(linearUpTo([[]])).toBe(1);
});

test('one value far out does not flatten all others', () => {
  const values = fc.array(fc.double({ min: -100, max: 100, noNaN: true }), { minLength: 8 });
  fc.assert(
    fc.property(values, (ordinary) => {
      const [low, high] = withoutOutliers([[...ordinary, 1e30, null, NaN]])!;
      expect(low).toBeGreaterThanOrEqual(-100);
      expect(high).toBeLessThanOrEqual(100);
    }),
  );
  expect(withoutOutliers([[null]])).toBeNull();
  expect(withoutOutliers([[5, 5, 5]])).toEqual([5, 5]);
  const clipped = yRange({ ...PLAIN, clipped: true }, [[1, 2, 3, 4, 1e30]], 1, 1e30);
  expect(clipped[1]).toBeLessThan(10);
  expect(yRange({ ...PLAIN, range: [2, 3] }, [[1, 9]], 1, 9)).toEqual([2, 3]);
});
