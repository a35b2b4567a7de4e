import { expect, test } from 'vitest';
import { StrokeBook } from '../colour';
import { historyLines, withHoles, type ServiceHistory } from './history';

const service = (worker: string, change: Partial<ServiceHistory> = {}): ServiceHistory => ({
  worker,
  kind: 'edge',
  run: 'r',
  slot: 0,
  host: 'h1',
  at: [100, 115, 130],
  cpu_percent: [1, 2, 3],
  rss_bytes: [10, 10, 10],
  messages_per_s: [0, 0, 0],
  dropped_per_s: [null, null, null],
  ...change,
});

test('every service that told something is a line before now', () => {
  const lines = historyLines([service('edge-aaaa')], 'cpu_percent', new StrokeBook(), 130);
  expect(lines).toMatchObject([{ label: 'Edge 0', x: [-30, -15, 0], value: [1, 2, 3] }]);
  expect(historyLines([service('a')], 'dropped_per_s', new StrokeBook(), 130)).toEqual([]);
});

test('services that are called alike are told apart', () => {
  const both = [service('edge-aaaa'), service('edge-bbbb', { host: 'h2' })];
  const labels = historyLines(both, 'rss_bytes', new StrokeBook(), 0).map((line) => line.label);
  expect(labels).toEqual(['Edge 0, aaaa on h1', 'Edge 0, bbbb on h2']);
});

test('a service that was away leaves a hole', () => {
  const { x, value } = withHoles([0, 15, 30, 330, 345], [1, 2, 3, 4, 5]);
  expect(value).toEqual([1, 2, 3, null, 4, 5]);
  expect(x).toEqual([0, 15, 30, 180, 330, 345]);
  expect(withHoles([], [])).toEqual({ x: [], value: [] });
  expect(withHoles([7], [1])).toEqual({ x: [7], value: [1] });
});
