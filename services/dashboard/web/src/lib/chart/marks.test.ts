import { expect, test } from 'vitest';
import { resumptions } from './marks';

const series = (x: number[], min: number[], max: number[] = min) => ({ x, min, max });

test('a mark stands where an attempt begins, but for the first', () => {
  expect(resumptions(series([0, 1, 2, 3, 4], [1, 1, 2, 2, 4]))).toEqual([
    { x: 2, text: 'attempt 2' },
    { x: 4, text: 'attempt 4' },
  ]);
  expect(resumptions(series([0, 1], [3, 3]))).toEqual([]);
  expect(resumptions(undefined)).toEqual([]);
});

test('one that begins within a bucket is marked, once', () => {
  expect(resumptions(series([0, 64, 128], [1, 1, 2], [1, 2, 2]))).toEqual([
    { x: 64, text: 'attempt 2' },
  ]);
  expect(resumptions(series([0, 64], [1, 2], [2, 2]))).toEqual([{ x: 0, text: 'attempt 2' }]);
});
