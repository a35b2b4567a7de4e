import { expect, test } from 'vitest';
import { backoffS } from './backoff';
import { ServerClock } from './clock';
import { RateMeter } from './meter';
import { frameToRgba } from './pixels';

test('reconnections wait longer and longer, from 1 s to 30 s, with a random half', () => {
  const longest = [0, 1, 2, 3, 4, 5, 50].map((attempt) => backoffS(attempt, () => 1));
  expect(longest).toEqual([1, 2, 4, 8, 16, 30, 30]);
  expect(backoffS(5, () => 0)).toBe(15);
});

test('the server clock follows the fastest message, and a changed clock after a minute', () => {
  let local = 1000;
  const clock = new ServerClock(() => local);
  clock.observe(1499.9); // 0.1 s on its way
  clock.observe(1499.5);
  expect(clock.nowUnixS()).toBeCloseTo(1499.9);
  clock.observe(1500);
  expect(clock.nowUnixS()).toBe(1500);
  local = 1070;
  clock.observe(1070);
  expect(clock.nowUnixS()).toBe(1070);
});

test('the rate counts what happened in the window', () => {
  const meter = new RateMeter(1000);
  for (let ms = 0; ms <= 2000; ms += 100) meter.add(ms);
  expect(meter.perSecond(2000)).toBe(10);
  expect(meter.perSecond(9000)).toBe(0);
});

test('stacked frames come newest first, colour planes as RGB and one plane as gray', () => {
  const stack = {
    pixels: Uint8Array.from([1, 2, 3, 4, 5, 6, 11, 12, 13, 14, 15, 16]),
    channels: 6,
    heightPx: 1,
    widthPx: 2,
    framesStacked: 2,
  };
  expect([...frameToRgba(stack, 0)]).toEqual([11, 13, 15, 255, 12, 14, 16, 255]);
  expect([...frameToRgba(stack, 1)]).toEqual([1, 3, 5, 255, 2, 4, 6, 255]);
  const gray = { ...stack, pixels: Uint8Array.from([7, 9]), channels: 1, framesStacked: 1 };
  expect([...frameToRgba(gray, 0)]).toEqual([7, 7, 7, 255, 9, 9, 9, 255]);
  expect(() => frameToRgba(gray, 1)).toThrow(RangeError);
});
