import fc from 'fast-check';
import { expect, test } from 'vitest';
import { chartCsv, csv, fileName } from './csv';
import { planOf, shapeOf, type Line } from './plan';

const stroke = { colour: 0, dash: [] };
const aLine = fc
  .uniqueArray(fc.integer({ min: 0, max: 50 }), { minLength: 1, maxLength: 20 })
  .chain((xs) =>
    fc.record({
      key: fc.uuid(),
      label: fc.string(),
      stroke: fc.constant(stroke),
      x: fc.constant([...xs].sort((a, b) => a - b)),
      value: fc.array(fc.option(fc.integer()), { minLength: xs.length, maxLength: xs.length }),
    }),
  );

test('every value stands at its x, and nowhere else', () => {
  fc.assert(
    fc.property(fc.array(aLine, { minLength: 1, maxLength: 5 }), (lines: Line[]) => {
      const plan = planOf(lines, 0);
      const xs = [...plan.columns[0]!];
      expect(xs).toEqual([...new Set(lines.flatMap((line) => line.x))].sort((a, b) => a! - b!));
      lines.forEach((line, i) => {
        const column = plan.columns[plan.mainColumn[i]!]!;
        xs.forEach((x, at) => {
          const own = line.x.indexOf(x!);
          expect(column[at]).toBe(own < 0 ? undefined : line.value[own]);
        });
      });
    }),
  );
});

const banded: Line = {
  key: 'a',
  label: 'alpha 0.9',
  stroke,
  x: [0, 1],
  value: [1, 3],
  low: [0, 2],
  high: [2, 4],
  n: [3, 2],
};

test('the band lies between high and low, the raw line behind the smooth one', () => {
  const plan = planOf([banded], 0.5);
  const [high, low] = plan.bands[0]!.series;
  expect(plan.columns[high]).toEqual([2, 4]);
  expect(plan.columns[low]).toEqual([0, 2]);
  expect(plan.series.map(({ part }) => part)).toEqual(['high', 'low', 'raw', 'value']);
  expect(plan.columns[plan.mainColumn[0]!]![1]).toBeCloseTo(7 / 3, 12);
});

test('new numbers keep a chart, another line makes a new one', () => {
  const shape = shapeOf([banded], 0);
  expect(shapeOf([{ ...banded, x: [0, 1, 2], value: [1, 3, 4] }], 0)).toBe(shape);
  expect(shapeOf([banded, { ...banded, key: 'b' }], 0)).not.toBe(shape);
  expect(shapeOf([banded], 0.4)).not.toBe(shape);
});

test('CSV has all points, unsmoothed, and quotes what needs it', () => {
  expect(chartCsv([banded], 'iteration', 'return, px')).toBe(
    'line,iteration,"return, px",low,high,seeds\r\n' +
      'alpha 0.9,0,1,0,2,3\r\n' +
      'alpha 0.9,1,3,2,4,2\r\n',
  );
  expect(csv(['a'], [['say "x"'], [null], [1e-9]])).toBe('a\r\n"say ""x"""\r\n\r\n1e-9\r\n');
  expect(csv(['a'], [['=1+1', -1]])).toBe("a\r\n'=1+1,-1\r\n");
  expect(fileName('max |P|, λ', 'csv')).toBe('max-p-λ.csv');
});
