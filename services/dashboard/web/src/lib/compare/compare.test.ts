import { expect, test } from 'vitest';
import type { Heatmap, Series } from '../api/types';
import { contrast, StrokeBook } from '../colour';
import { View } from '../router';
import { extremes, rowsOf } from './heatmap';
import { linesOf } from './lines';
import { groupingOf, metricsOf, sharedQuery, subjectOf } from './view';

const column = [1, 2];
const base: Series = {
  metric: 'return_px',
  key: 'k',
  label: '',
  group: {},
  run_ids: ['r1'],
  seeds: 1,
  n_points: 2,
  bucket: 0,
  x: column,
  n: column,
  value: column,
  low: [0, 1],
  high: [2, 3],
  min: [-1, 0],
  max: [3, 4],
  last: column,
};

test('a group has its band and its n, a run has neither unless its points are in buckets', () => {
  const labels = { run: (id: string) => `named ${id}` };
  const group = { ...base, key: 'g', group: { alpha: 0.9 }, run_ids: ['r1', 'r2'], seeds: 2 };
  const [run, buckets, gathered] = linesOf(
    [base, { ...base, key: 'b', bucket: 4 }, group],
    new StrokeBook(),
    labels,
  );
  expect(run).toMatchObject({ label: 'named r1' });
  expect(run).not.toHaveProperty('low');
  expect(buckets).toMatchObject({ low: [-1, 0], high: [3, 4] });
  expect(gathered).toMatchObject({ label: 'alpha 0.9', low: [0, 1], n: column });
  expect(gathered).not.toHaveProperty('repeats');
});

test('a group whose seeds were run more than once says so', () => {
  const ids = Array.from({ length: 14 }, (_, i) => `r${i}`);
  const often = { ...base, key: 'g', group: { alpha: 0.9 }, run_ids: ids, seeds: 3 };
  const [line] = linesOf([often], new StrokeBook(), { run: (id) => id });
  expect(line).toMatchObject({ repeats: '14 runs, 3 seeds' });
});

test('chosen runs stand for themselves, a filter is gathered over seeds', () => {
  const chosen = View.parse('?page=compare&runs=a,b&band=ci95&range=3,9');
  expect(sharedQuery(chosen, subjectOf(chosen)!)).toEqual({
    runs: ['a', 'b'],
    group_by: null,
    x: 'iteration',
    range: [3, 9],
    statistic: 'mean',
    band: 'ci95',
  });
  const sweep = View.parse('?page=compare&sweep_id=s&config.alpha=0.9');
  expect(sharedQuery(sweep, subjectOf(sweep)!)).toMatchObject({
    filter: { sweep_id: 's', 'config.alpha': '0.9' },
    group_by: 'all_but_seed',
  });
  const by = sweep.with({ by: ['alpha', 'hidden_units'] });
  expect(groupingOf(by, subjectOf(by)!)).toEqual(['alpha', 'hidden_units']);
  expect(groupingOf(by.with({ by: ['run'] }), subjectOf(by)!)).toBeNull();
  expect(subjectOf(View.parse('?page=compare&by=alpha'))).toBeNull();
  expect(metricsOf(View.parse('?metrics=loss,scale'), ['return_px'])).toEqual(['loss', 'scale']);
});

const MAP: Heatmap = {
  metric: 'return_px',
  value: 'last_mean',
  x: { key: 'alpha', values: [0.5, 0.9] },
  y: { key: 'hidden_units', values: [50, 100] },
  cells: [
    { x: 0.5, y: 50, n: 3, mean: -300, std: 10, run_ids: [] },
    { x: 0.9, y: 50, n: 1, mean: -200, std: null, run_ids: [] },
    { x: 0.9, y: 100, n: 2, mean: -100, std: 5, run_ids: [] },
  ],
};

test.each(['light', 'dark'] as const)(
  'cells stand in their place, readable in the %s theme',
  (theme) => {
    const rows = rowsOf(MAP, theme);
    expect(rows.map((row) => row.y)).toEqual([100, 50]);
    expect(rows[0]!.cells[0]!.cell).toBeNull();
    expect(rows[0]!.cells[1]!.cell?.mean).toBe(-100);
    for (const { cell, background, text } of rows.flatMap((row) => row.cells)) {
      if (cell) expect(contrast(background, text)).toBeGreaterThanOrEqual(4.5);
    }
    expect(extremes(MAP)).toEqual([-300, -100]);
    expect(extremes({ ...MAP, cells: [] })).toBeNull();
  },
);
