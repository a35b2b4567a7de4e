import { expect, test } from 'vitest';
import type { Run } from './api/types';
import { again, atPoint, firstComparison, onwards, sweepAgain } from './start';

const RUN = {
  id: 'run-1',
  name: 'first',
  task: 'pointing',
  config: { task: 'pointing', alpha: 0.9, init_from: 'abc:3:00ff' },
} as unknown as Run;

test('another run like one begins with the same weights, and a continued one with its own', () => {
  expect(again(RUN)).toEqual({
    from: { task: 'pointing', alpha: 0.9, init_from: 'abc:3' },
    name: 'first, again',
  });
  expect(onwards(RUN).from).toMatchObject({ alpha: 0.9, init_from: 'run-1' });
});

test('a sweep is made again with its grid as it would be typed', () => {
  const sweep = {
    name: '',
    config: { task: 'pointing' },
    grid: { alpha: [0.5, 0.9], crop: ['0,0,9,9', '1,1,2,2'] },
    seeds: [0, 1, 5],
  };
  expect(sweepAgain(sweep)).toEqual({
    from: { task: 'pointing' },
    sweep: true,
    axes: [
      { key: 'alpha', text: '0.5, 0.9' },
      { key: 'crop', text: '0,0,9,9; 1,1,2,2' },
    ],
    seeds: '0, 1, 5',
    name: '',
  });
});

test('a point of a heat map is started with the seeds of the others', () => {
  expect(atPoint(RUN.config, { alpha: 0.2 }, [3, 4])).toMatchObject({
    from: { alpha: 0.2, init_from: 'abc:3' },
    seeds: '3, 4',
  });
  expect(atPoint(RUN.config, {}, []).seeds).toBe('0-2');
  expect(firstComparison('pointing')).toMatchObject({ seeds: '0-2', then: 'results' });
});
