import fc from 'fast-check';
import { expect, test } from 'vitest';
import * as format from './format';

const plain = (text: string): string => text.replaceAll('\u202f', ' ').replaceAll('\u2212', '-');

test.each([
  [0, '0'],
  [-98.43, '-98.43'],
  [-834.5678, '-834.6'],
  [0.000123456, '0.0001235'],
  [1234567, '1,234,567'],
  [3.2e-9, '3.20e-9'],
  [Infinity, '∞'],
  [null, '–'],
  [NaN, '–'],
])('number(%s) is %s', (value, text) => expect(plain(format.number(value))).toBe(text));

test('minus signs are set before numbers alone', () => {
  const set = format.typeset('pan by -4°, tilt by 2°, gym-v1-2');
  expect(set).toBe('pan by \u22124°, tilt by 2°, gym-v1-2');
});

test('a number keeps its significant digits', () => {
  const numbers = fc.double({ min: 1e-3, max: 1e8, noNaN: true });
  fc.assert(
    fc.property(numbers, (value) => {
      const shown = Number(plain(format.number(value, 4)).replaceAll(',', ''));
      expect(Math.abs(shown - value)).toBeLessThanOrEqual(value * 0.5001e-3);
    }),
  );
});

test.each([
  [7.04e-6, '7.04 µs'],
  [0.0123, '12.3 ms'],
  [2, '2 s'],
  [59.99, '1 min'],
  [185, '3 min 05 s'],
  [7800, '2 h 10 min'],
  [356400, '4 d 03 h'],
  [0, '0 s'],
])('duration(%s) is %s', (seconds, text) => expect(plain(format.duration(seconds))).toBe(text));

test.each([
  [100.4, 100, 'now'],
  [100, 112.9, '12 s ago'],
  [100, 100 + 3 * 60 + 59, '3 min ago'],
  [100, 100 + 26 * 3600, '1 d ago'],
  [130, 100, 'now'],
  [7300, 100, 'in 2 h'],
])('age(%s) at %s is %s', (at, now, text) => expect(plain(format.age(at, now))).toBe(text));

test.each([
  [0, '0 B'],
  [1023, '1,023 B'],
  [1024, '1 KiB'],
  [11_059, '10.8 KiB'],
  [5 * 1024 ** 3, '5 GiB'],
])('bytes(%s) is %s', (value, text) => expect(plain(format.bytes(value))).toBe(text));

test('quantities have their unit', () => {
  expect(plain(format.quantity(-98.4, 'px'))).toBe('-98.4 px');
  expect(plain(format.quantity(0.0021, 'share'))).toBe('0.21 %');
  expect(plain(format.si(1234, 'Hz'))).toBe('1.23 kHz');
  expect(format.plural(1, 'run')).toBe('1 run');
  expect(format.plural(1200, 'run')).toBe('1,200 runs');
});
