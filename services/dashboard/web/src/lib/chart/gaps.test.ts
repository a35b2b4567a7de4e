import { expect, test } from 'vitest';
import { alone, noneSince } from './gaps';

test('a value between two holes has a dot, whatever other lines have there', () => {
  expect(alone([1, null, 2, null, 3, 4])).toEqual([0, 2]);
  expect(alone([1, undefined, 2, undefined, null, 5])).toEqual([5]);
  expect(alone([undefined, 7, undefined])).toEqual([1]);
  expect(alone([null, null])).toEqual([]);
});

test('a line whose newest values are missing says since when', () => {
  expect(noneSince({ x: [0, 1, 2, 3], value: [1, 2, null, null] })).toBe(2);
  expect(noneSince({ x: [0, 1, 2], value: [1, null, 2] })).toBeNull();
  expect(noneSince({ x: [4, 5], value: [null, null] })).toBe(4);
  expect(noneSince({ x: [], value: [] })).toBeNull();
});
