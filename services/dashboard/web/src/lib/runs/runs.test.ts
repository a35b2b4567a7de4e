import fc from 'fast-check';
import { expect, test, vi } from 'vitest';
import type { Run, RunPage, RunQuery } from '../api/types';
import { View } from '../router';
import { columnOf, COLUMNS, DEFAULT_COLUMNS, nameOf } from './columns';
import { countOf } from '../statistics';
import { differingKeys, groupLabel, groupRuns } from './groups';
import { PAGE_SIZE, RunList } from './list';
import { filterOf, nextSort, parametersOf } from './query';
import { toggled, toggledRange } from './selection';
import { rowWindow } from './window';

function aRun(i: number, change: Partial<Run> = {}): Run {
  return {
    id: `run-${i}`,
    name: `run ${i}`,
    state: 'running',
    desired_state: 'running',
    task: 'pointing',
    algorithm: 'bpn',
    seed: i,
    config: { alpha: 0.9, hidden_units: 100, seed: i },
    config_hash: '',
    attempt: 1,
    iteration: i,
    iterations: 50,
    weights_version: i,
    summary: {
      returns: { metric: 'return_px', unit: 'px', last: -i, best: -i, mean_last_5: -i },
      length: { last: 20 },
    },
    error: '',
    waiting_reason: '',
    waiting_since_unix_s: null,
    notes: '',
    tags: [],
    sweep_id: null,
    priority: 0,
    values: {},
    archived_at_unix_s: null,
    created_at_unix_s: 0,
    updated_at_unix_s: 0,
    disk_bytes: null,
    rev: 1,
    ...change,
  };
}

/** A server with so many runs; its cursors are positions. */
function server(total: number) {
  const queries: RunQuery[] = [];
  return {
    queries,
    fetch: (query: RunQuery): Promise<RunPage> => {
      queries.push(query);
      const from = Number(query.cursor ?? 0);
      const end = Math.min(from + (query.limit ?? 0), total);
      const items = Array.from({ length: end - from }, (_, i) =>
        aRun(from + i, { values: { kept: from + i } }),
      );
      return Promise.resolve({ items, next_cursor: end < total ? String(end) : null, total });
    },
  };
}

const settled = (list: RunList) => vi.waitFor(() => expect(list.state.value.loading).toBe(false));

test('a run that was removed leaves the list, and one that was not in it changes nothing', async () => {
  const { fetch } = server(5);
  const list = new RunList(fetch);
  list.show({});
  await vi.waitFor(() => expect(list.state.value.total).toBe(5));
  list.apply({ id: 'new', rev: 1 });
  expect(list.state.value.newer).toBe(1);
  list.apply({ id: 'run-3', removed: true });
  list.apply({ id: 'new', removed: true });
  expect(list.state.value.rows.map((run) => run.id)).toEqual(['run-0', 'run-1', 'run-2', 'run-4']);
  expect(list.state.value).toMatchObject({ total: 4, newer: 0 });
});

test('a list reads as far as somebody looks, and all of it when it must', async () => {
  const { fetch, queries } = server(1050);
  const list = new RunList(fetch);
  list.show({ search: 'x' });
  await settled(list);
  expect(list.state.value).toMatchObject({ total: 1050, problem: null });
  expect(list.state.value.rows).toHaveLength(PAGE_SIZE);
  list.ensure(450);
  await settled(list);
  expect(list.state.value.rows).toHaveLength(3 * PAGE_SIZE);
  list.ensure(Infinity);
  await settled(list);
  expect(list.state.value.rows.map((run) => run.id)).toEqual(
    Array.from({ length: 1050 }, (_, i) => `run-${i}`),
  );
  expect(queries).toHaveLength(6);
  expect(queries.every((query) => query.search === 'x')).toBe(true);
  list.ensure(Infinity);
  expect(queries).toHaveLength(6);
});

test('changes stay in their row; older ones and strangers do not enter', async () => {
  const list = new RunList(server(3).fetch);
  list.show({});
  await settled(list);
  list.apply({ id: 'run-1', rev: 2, state: 'finished' });
  list.apply({ id: 'run-1', rev: 1, state: 'queued' });
  list.apply({ id: 'run-2', rev: 3, values: {} });
  expect(list.state.value.rows[2]?.values).toEqual({ kept: 2 }); // live news have none
  expect(list.state.value.rows.map((run) => run.state)).toEqual(['running', 'finished', 'running']);
  list.apply(aRun(9));
  list.apply(aRun(9));
  expect(list.state.value).toMatchObject({ newer: 1, total: 3 });
  list.refresh();
  await settled(list);
  expect(list.state.value.newer).toBe(0);
});

test('an answer to an older question is dropped', async () => {
  const answers: ((page: RunPage) => void)[] = [];
  const list = new RunList(() => new Promise((resolve) => answers.push(resolve)));
  list.show({ search: 'old' });
  list.show({ search: 'new' });
  answers[1]?.({ items: [aRun(2)], next_cursor: null, total: 1 });
  await settled(list);
  answers[0]?.({ items: [aRun(1)], next_cursor: null, total: 1 });
  await Promise.resolve();
  expect(list.state.value.rows.map((run) => run.id)).toEqual(['run-2']);
});

test('a failure is shown and what was read stays', async () => {
  let broken = false;
  const good = server(400);
  const list = new RunList((query) =>
    broken ? Promise.reject(new Error('gone')) : good.fetch(query),
  );
  list.show({});
  await settled(list);
  broken = true;
  list.ensure(400);
  await settled(list);
  expect(list.state.value.problem?.detail).toContain('gone');
  expect(list.state.value.rows).toHaveLength(PAGE_SIZE);
  broken = false;
  list.refresh();
  await settled(list);
  expect(list.state.value.problem).toBeNull();
});

test('archived runs leave the list', async () => {
  const list = new RunList(server(5).fetch);
  list.show({});
  await settled(list);
  list.remove(new Set(['run-0', 'run-4', 'elsewhere']));
  expect(list.state.value.total).toBe(3);
  list.apply({ id: 'run-3', rev: 5, name: 'renamed' });
  expect(list.state.value.rows.map((run) => run.name)).toEqual(['run 1', 'run 2', 'renamed']);
});

test('the window covers what is seen and stands for all other rows', () => {
  const whole = fc.integer({ min: 0, max: 20_000 });
  fc.assert(
    fc.property(whole, whole, fc.integer({ min: 1, max: 2000 }), (rows, scroll, view) => {
      const { first, end, beforePx, afterPx } = rowWindow(scroll, view, 34, rows);
      expect(beforePx + (end - first) * 34 + afterPx).toBe(rows * 34);
      const last = Math.max(0, rows * 34 - view);
      const top = Math.min(scroll, last);
      expect(first * 34).toBeLessThanOrEqual(top);
      expect(end * 34).toBeGreaterThanOrEqual(Math.min(rows * 34, top + view));
      expect(end - first).toBeLessThanOrEqual(Math.ceil(view / 34) + 16);
    }),
  );
});

test('groups hold every run once, with figures of all of them', () => {
  const runs = Array.from({ length: 12 }, (_, i) => aRun(i, { config: { alpha: i % 3, seed: i } }));
  const groups = groupRuns(runs, ['alpha']);
  expect(groups.map((group) => group.values.alpha)).toEqual([0, 1, 2]);
  expect(groups.flatMap((group) => group.runs)).toHaveLength(12);
  expect(groups[1]?.last).toMatchObject({ runs: 4, seeds: 4, mean: -5.5 });
  expect(groups[0]?.states).toEqual({ running: 4 });
  expect(groupRuns(runs, [])).toHaveLength(1);
  expect(differingKeys(runs)).toEqual(['alpha']);
  const often = [...Array.from({ length: 11 }, () => aRun(0)), aRun(0), aRun(1), aRun(2)];
  expect(groupRuns(often, [])[0]).toMatchObject({
    seeds: 3,
    last: { runs: 14, seeds: 3, mean: -1 },
  });
  expect(countOf(14, 3)).toBe('14 runs, 3 seeds');
  expect(countOf(3, 3)).toBe('3 runs');
  expect(groupLabel({ alpha: 0.95, hidden_units: 100 })).toBe('alpha 0.95, hidden_units 100');
});

test('a filter survives the trip through a URL', () => {
  const query: RunQuery = {
    search: 'wide',
    state: 'running,lost',
    task: 'sorting',
    config: { alpha: '0.9' },
    archived: true,
  };
  expect(filterOf(new View().with(parametersOf(query)))).toEqual(query);
  expect(filterOf(new View())).toEqual({});
});

test('a heading sorts one way, the other way, and back to the newest first', () => {
  expect(nextSort('-created_at', 'return_best', true)).toBe('-return_best');
  expect(nextSort('-return_best', 'return_best', true)).toBe('return_best');
  expect(nextSort('return_best', 'return_best', true)).toBe('-created_at');
  expect(nextSort('-created_at', 'name', false)).toBe('name');
  expect(nextSort('-created_at', 'created_at', true)).toBe('created_at');
});

test('a range takes the state of its last row', () => {
  const ids = ['a', 'b', 'c', 'd'];
  expect([...toggledRange(new Set(), ids, 'a', 'c')]).toEqual(['a', 'b', 'c']);
  expect([...toggledRange(new Set(ids), ids, 'd', 'b')]).toEqual(['a']);
  expect([...toggledRange(new Set(), ids, 'gone', 'b')]).toEqual(['b']);
  expect([...toggled(new Set(['a']), 'a')]).toEqual([]);
});

test('every column says something, also of configuration keys', () => {
  const keys = COLUMNS.map((column) => column.key);
  expect(new Set(keys).size).toBe(keys.length);
  for (const key of DEFAULT_COLUMNS) expect(columnOf(key)).not.toBeNull();
  expect(columnOf('config.alpha')?.text(aRun(1))).toBe('0.9');
  expect(columnOf('config.alpha')?.sort).toBe('config.alpha');
  const loss = columnOf('metric.loss.mean_5');
  expect(loss).toMatchObject({ title: 'Loss, mean of last 5', sort: 'metric.loss.mean_5' });
  expect(loss?.text(aRun(1, { values: { 'metric.loss.mean_5': 0.25 } }))).toBe('0.25');
  expect(loss?.text(aRun(1))).toBe('–');
  expect(columnOf('metric.loss')).toBeNull();
  expect(columnOf('error')?.text(aRun(1, { error: 'bad\nTraceback' }))).toBe('bad');
  expect(columnOf('nonsense')).toBeNull();
  expect(nameOf({ id: '01234567-89ab', name: '', task: 'pointing' })).toBe('pointing 567-89ab');
});
