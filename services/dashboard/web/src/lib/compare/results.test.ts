import fc from 'fast-check';
import { expect, test } from 'vitest';
import type { ComparedGroup } from '../api/types';
import type { Line } from '../chart/plan';
import { View } from '../router';
import {
  columnTitle,
  higherIsBetter,
  metricColumn,
  METRIC_VALUES,
  readMetricColumn,
} from './columns';
import { differenceTo } from './lines';
import { comparisonQuery, intervalText, pText, seedsText } from './results';

const group = (runs: number, seeds: number, missing: number): ComparedGroup =>
  ({ runs, seeds, missing }) as ComparedGroup;

test('duplicates of seeds and seeds without a value are told', () => {
  expect(seedsText(group(14, 3, 0))).toBe('14 runs, 3 seeds');
  expect(seedsText(group(3, 3, 0))).toBe('3 seeds');
  expect(seedsText(group(1, 1, 0))).toBe('1 seed');
  expect(seedsText(group(4, 3, 1))).toBe('4 seeds, 1 without a value');
});

test('an interval is written with its value, and one seed has none', () => {
  expect(intervalText({ value: -310, low: -330, high: -295 }, '')).toBe('−310 [−330, −295]');
  expect(intervalText({ value: 2, low: null, high: null }, '')).toBe('2');
  expect(intervalText({ value: null, low: null, high: null }, 'px')).toBe('–');
  expect(intervalText({ value: 0.5, low: 0.25, high: 1 }, 'share')).toContain('[25, 100]');
  expect([pText(0.0004), pText(0.1)]).toEqual(['< 0.001', '0.1']);
});

test('a comparison gathers over seeds, also of chosen runs, unless the address says else', () => {
  const view = View.parse('?page=compare&runs=a,b&tab=results&base=k');
  const subject = { runs: ['a', 'b'], filter: {} };
  expect(comparisonQuery(view, subject, ['return_px'])).toEqual({
    runs: ['a', 'b'],
    group_by: 'all_but_seed',
    metric: 'return_px',
    value: 'mean_5',
    higher_is_better: true,
    baseline: 'k',
  });
  const loss = view.with({ cm: 'loss', cv: 'lowest', by: ['run'] });
  expect(comparisonQuery(loss, subject, [])).toMatchObject({
    group_by: null,
    value: 'lowest',
    higher_is_better: false,
  });
  expect(comparisonQuery(loss.with({ better: 'higher' }), subject, [])).toMatchObject({
    higher_is_better: true,
  });
});

test('a metric’s column is read back, also where its name has dots', () => {
  fc.assert(
    fc.property(
      fc.stringMatching(/^[a-z][a-z_.]{0,12}[a-z]$/),
      fc.constantFrom(...METRIC_VALUES),
      (metric, value) => {
        expect(readMetricColumn(metricColumn(metric, value))).toEqual({ metric, value });
      },
    ),
  );
  expect(readMetricColumn('config.alpha')).toBeNull();
  expect(readMetricColumn('metric.loss')).toBeNull();
  expect(columnTitle('metric.loss.mean_5')).toBe('Loss, mean of last 5');
  expect(columnTitle('config.alpha')).toBe('alpha');
  expect(['loss', 'update_s', 'return_px', 'eval_success'].map(higherIsBetter)).toEqual([
    false,
    false,
    true,
    true,
  ]);
});

const line = (key: string, x: number[], value: (number | null)[]): Line => ({
  key,
  label: key,
  stroke: { colour: 0, dash: [] },
  x,
  value,
});

test('differences to a baseline: its newest value counts, and behind its end there is none', () => {
  const base = line('base', [0, 2, 4], [10, 20, 40]);
  const other = {
    ...line('o', [0, 1, 3, 5], [11, 12, null, 50]),
    low: [9, 9, 9, 9],
    high: [20, 20, 20, 20],
  };
  const [own, less] = differenceTo([base, other], 'base');
  expect(own?.value).toEqual([0, 0, 0]);
  expect(less).toMatchObject({ value: [1, 2, null, null], low: [-1, -1, -11, null] });
  expect(differenceTo([base, other], 'gone')).toEqual([base, other]);
});
