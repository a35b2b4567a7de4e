import fc from 'fast-check';
import { expect, test } from 'vitest';
import { scaleOf, ticksOf } from './axes';
import { area, bar, label, line, titled, type Drawing, type Mark } from './drawing';
import { toPdf } from './pdf';
import { toSvg } from './svg';

const INK = { text: '#000000', muted: '#555555', line: '#dddddd', background: '#ffffff' };
const place = fc.double({ min: -1e4, max: 1e4, noNaN: true });
const marks = fc.array(
  fc.oneof(
    fc.record({ kind: fc.constant('circle' as const), x: place, y: place, r: place, fill: fc.constant('#112233') }),
    fc
      .tuple(fc.array(fc.tuple(place, place), { maxLength: 5 }), fc.boolean())
      .map(([points, closed]) => line(points, '#445566', 2, { closed, dash: [2, 3], alpha: 0.5 })),
    fc.tuple(place, place, fc.string({ unit: 'binary' })).map(([x, y, text]) => label(x, y, text, '#000000', { title: text, upright: x > 0 })),
  ),
  { maxLength: 6 },
); // prettier-ignore

function drawing(some: readonly Mark[]): Drawing {
  return { width: 300, height: 200, background: '#ffffff', marks: some };
}

test('any drawing is well-formed XML: nothing in a text ends it', () => {
  fc.assert(
    fc.property(marks, (some) => {
      const svg = toSvg(drawing(some as Mark[]));
      const open: string[] = [];
      for (const [, slash, name = '', , empty] of svg.matchAll(/<(\/?)(\w+)([^<>]*?)(\/?)>/g)) {
        if (slash) expect(open.pop()).toBe(name);
        else if (!empty) open.push(name);
      }
      expect(open).toEqual([]);
      expect(svg.replace(/<[^<>]*>/g, '')).not.toMatch(/[<>]/);
    }),
  );
});

test('every object of a PDF begins where its table says', () => {
  fc.assert(
    fc.property(marks, (some) => {
      const text = new TextDecoder('latin1').decode(toPdf(drawing(some as Mark[])));
      const table = Number(/startxref\n(\d+)\n%%EOF\n$/.exec(text)?.[1]);
      expect(text.slice(table, table + 4)).toBe('xref');
      const begins = [...text.slice(table).matchAll(/^(\d{10}) 00000 n $/gm)].map((one) => Number(one[1]));
      expect(begins).toHaveLength(6);
      begins.forEach((at, i) => expect(text.slice(at, at + 7)).toBe(`${i + 1} 0 obj`));
      const stream = /\/Length (\d+) >>\nstream\n/.exec(text);
      const from = (stream?.index ?? 0) + (stream?.[0].length ?? 0);
      expect(text.slice(from + Number(stream?.[1]), from + Number(stream?.[1]) + 10)).toBe('\nendstream');
    }),
  ); // prettier-ignore
});

test('parentheses are no end of a text, and what Helvetica lacks is spelled or asked for', () => {
  const pdf = new TextDecoder('latin1').decode(toPdf(drawing([label(1, 2, '(\\) −1 λ 字 ±', '#000000')])));
  expect(pdf).toContain('(\\(\\\\\\) -1 lambda ? \u00b1) Tj');
}); // prettier-ignore

test('ticks are even, in the range, and about as many as wanted', () => {
  fc.assert(
    fc.property(
      fc.double({ min: -1e6, max: 1e6, noNaN: true }),
      fc.double({ min: 1e-3, max: 1e6, noNaN: true }),
      fc.integer({ min: 2, max: 10 }),
      (low, size, about) => {
        const ticks = ticksOf(low, low + size, about);
        expect(ticks.length).toBeLessThanOrEqual(about + 1);
        for (const tick of ticks) {
          expect(tick).toBeGreaterThanOrEqual(low - size * 1e-6);
          expect(tick).toBeLessThanOrEqual(low + size * (1 + 1e-6));
        }
      },
    ),
  );
  expect(ticksOf(0, 1, 5)).toEqual([0, 0.2, 0.4, 0.6000000000000001, 0.8, 1]);
  expect(ticksOf(3, 3, 5)).toEqual([3]);
});

test('a scale puts the extremes inside, also of one value and of none', () => {
  const scale = scaleOf([2, 4], 0, 100);
  expect(scale(2)).toBeCloseTo(4.5, 1);
  expect(scale(4)).toBeCloseTo(95.5, 1);
  expect(scaleOf([7], 0, 100)(7)).toBeCloseTo(50);
  expect(scaleOf([], 0, 100).ticks.length).toBeGreaterThan(1);
});

test('a title moves everything down', () => {
  const marked = drawing([area([[0, 0], [1, 1], [2, 0]], '#123456', 0.5), bar(0, 0, 2, 2, '#123456')]);
  const found = titled(marked, 'Return', INK);
  expect(found.height).toBe(228);
  expect(found.marks[1]).toMatchObject({ points: [[0, 28], [1, 29], [2, 28]] });
}); // prettier-ignore
