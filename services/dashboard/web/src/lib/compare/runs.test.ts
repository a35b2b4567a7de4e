import { expect, test } from 'vitest';
import type { RunValues } from '../api/types';
import {
  axisOf,
  distributionsOf,
  dotsOf,
  parallelOf,
  profilesOf,
  scatterOf,
} from '../vector/figures';
import type { Drawing } from '../vector/drawing';
import { colours, dotsOfRuns, linesOfRuns, shownText, tableOfRuns } from './runs';

const INK = { text: '#000000', muted: '#555555', line: '#dddddd', background: '#ffffff' };
const VALUES: RunValues = {
  total: 10,
  ids: ['a', 'b', 'c'],
  names: ['one', 'two', 'three'],
  seeds: [0, 1, 2],
  columns: {
    'config.alpha': [0.5, 0.9, 0.9],
    'config.crop': ['x', 'y', 'x'],
    'metric.loss.last': [1, null, 3],
  },
};

/** Nothing is outside of the picture or not a number. */
function inside({ width, height, marks }: Drawing): void {
  for (const mark of marks) {
    const points = mark.kind === 'path' ? mark.points : [[mark.x, mark.y] as const];
    for (const [x, y] of points) {
      expect(x).toBeGreaterThanOrEqual(-1);
      expect(x).toBeLessThanOrEqual(width + 1);
      expect(y).toBeGreaterThanOrEqual(-1);
      expect(y).toBeLessThanOrEqual(height + 1);
    }
  }
}

test('runs without a value of an axis are left out and told', () => {
  const dots = dotsOfRuns(VALUES, { x: 'config.alpha', y: 'metric.loss.last', by: '' }, 'light');
  expect(dots.map((dot) => [dot.x, dot.y])).toEqual([[0.5, 1], [0.9, 3]]); // prettier-ignore
  expect(dots[0]?.title).toContain('one\nalpha 0.5');
  expect(shownText(VALUES, dots.length)).toBe('the newest 3 of 10 runs, 1 without a value');
  expect(tableOfRuns(VALUES, ['config.crop']).rows[1]).toEqual(['two', 1, 'y']);
});

test('colours go by rank, so that one outlier leaves the others apart', () => {
  const given = colours([1, 2, 1e9, null, 2], 'light');
  expect(new Set(given.slice(0, 3)).size).toBe(3);
  expect(given[1]).toBe(given[4]);
  expect(colours([7], 'dark')).toHaveLength(1);
});

test('texts stand in a row beside numbers', () => {
  const axis = axisOf(['y', 'x', 3], 0, 100);
  expect(axis.ticks.map((tick) => tick.text)).toEqual(['3', 'x', 'y']);
  expect(axis.at('x')).toBe(50);
});

test.each([320, 900])('every figure stays in its picture of %d pixels', (width) => {
  const group = { key: 'k', label: 'alpha 0.95, a rather long name of a group of runs', colour: '#123456' };
  const columns = Object.keys(VALUES.columns);
  inside(scatterOf(dotsOfRuns(VALUES, { x: 'config.crop', y: 'metric.loss.last', by: '' }, 'dark'), width, 300, INK, { x: 'x', y: 'y' }));
  inside(parallelOf(columns, linesOfRuns(VALUES, columns, 'light'), width, 300, INK));
  inside(dotsOf([{ ...group, scores: [{ seed: 0, score: -3 }, { seed: 1, score: 1e30 }], iqm: { value: 0, low: -3, high: 1e30 } }], width, INK, { title: 'x' }));
  inside(profilesOf([0, 1, 2], [{ ...group, dash: [], share: [1, 0.5, 0], low: [1, null, 0], high: [1, 1, 0] }], width, 200, INK, 'x'));
  inside(distributionsOf([0, 1, 2], [{ ...group, shares: [0.25, 0.75] }], width, INK, 'x'));
}); // prettier-ignore

test('a picture of profiles says which line is whose', () => {
  const one = { key: 'k', colour: '#123456', dash: [], share: [1, 0], low: [1, 0], high: [1, 0] };
  const groups = Array.from({ length: 7 }, (_, i) => ({ ...one, label: `alpha=0.${i}` }));
  const drawing = profilesOf([0, 1], groups, 320, 200, INK, 'x');
  inside(drawing);
  const texts = drawing.marks.flatMap((mark) => (mark.kind === 'text' ? [mark.text] : []));
  expect(texts).toEqual(expect.arrayContaining(groups.map((group) => group.label)));
});

test('a line stops where a run has no value', () => {
  const columns = ['config.alpha', 'metric.loss.last', 'config.crop'];
  const [, second] = linesOfRuns(VALUES, columns, 'light');
  expect(second?.values).toEqual([0.9, null, 'y']);
  const drawing = parallelOf(columns, [second!], 600, 300, INK);
  expect(drawing.marks.filter((mark) => mark.key === 'b')).toHaveLength(2);
});
