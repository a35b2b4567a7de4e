import { expect, test } from 'vitest';
import { Problem } from '../api/problem';
import type { BulkAction, Run } from '../api/types';
import { Toasts } from '../toasts';
import { RunActions } from './actions';
import { isPossible } from './possible';

const ACTIONS: BulkAction[] = ['stop', 'resume', 'archive', 'unarchive', 'remove', 'restore'];
const ids = (n: number) => Array.from({ length: n }, (_, i) => `run-${i}`);

/** Archives what it is asked to; every `lost`-th answer does not arrive. */
function server(lost = Infinity) {
  const archived = new Set<string>();
  const sizes: number[] = [];
  const runs = {
    bulk: (_action: BulkAction, some: string[]) => {
      sizes.push(some.length);
      for (const id of some) archived.add(id);
      if (sizes.length % lost === 0) return Promise.reject(new Problem(0, 'no answer'));
      return Promise.resolve({ results: some.map((id) => ({ id, ok: true })) });
    },
    get: (id: string) =>
      Promise.resolve({ archived_at_unix_s: archived.has(id) ? 1 : null } as Run),
  };
  return {
    api: { runs } as unknown as ConstructorParameters<typeof RunActions>[0],
    archived,
    sizes,
  };
}

test('2,000 runs are done in small pieces, with progress that ends true', async () => {
  const { api, archived, sizes } = server();
  const toasts = new Toasts();
  const said: string[] = [];
  toasts.all.subscribe((all) => said.push(...all.map((toast) => toast.text)));
  let changed = 0;
  await new RunActions(api, toasts, (done) => (changed = done.size)).act('archive', ids(2000));
  expect(archived.size).toBe(2000);
  expect(Math.max(...sizes)).toBeLessThanOrEqual(50);
  expect(said).toContain('1,000 of 2,000 runs archived');
  expect(toasts.all.value.map((toast) => toast.text)).toEqual(['2,000 runs archived']);
  expect(changed).toBe(2000);
});

test('what was done is told as done, though the answer was lost', async () => {
  const { api } = server(2);
  const toasts = new Toasts();
  let changed = 0;
  await new RunActions(api, toasts, (done) => (changed = done.size), 0).act('archive', ids(120));
  expect(changed).toBe(120);
  expect(toasts.all.value.map((toast) => toast.text)).toEqual(['120 runs archived']);
});

test('a server that is away is told once, with how many were not done', async () => {
  const runs = {
    bulk: () => Promise.reject(new Problem(0, 'no answer')),
    get: () => Promise.reject(new Problem(0, 'no answer')),
  };
  const toasts = new Toasts();
  const api = { runs } as unknown as ConstructorParameters<typeof RunActions>[0];
  await new RunActions(api, toasts, () => {}, 0).act('archive', ids(70));
  expect(toasts.all.value.map((toast) => [toast.kind, toast.text])).toEqual([
    ['problem', '70 runs: not archived'],
  ]);
});

test('what is left can be left, and what was done can be undone', async () => {
  const { api, archived } = server();
  const toasts = new Toasts();
  const acting = new RunActions(api, toasts, () => {}).act('archive', ids(500));
  toasts.all.value[0]?.action?.run();
  await acting;
  expect(archived.size).toBe(50);
  const [told] = toasts.all.value;
  expect(told?.text).toBe('50 runs archived, 450 left as they were');
  expect(told?.action?.label).toBe('Undo');
});

const OFFERED: [Partial<Run>, BulkAction[]][] = [
  [{ state: 'queued', desired_state: 'running' }, ['stop']],
  [{ state: 'running', desired_state: 'running' }, ['stop']],
  [{ state: 'lost', desired_state: 'running' }, ['stop']],
  [{ state: 'stopping', desired_state: 'stopped' }, []],
  [{ state: 'finished', desired_state: 'stopped' }, ['archive', 'remove']],
  [{ state: 'finished', desired_state: 'running' }, ['archive', 'remove']],
  [{ state: 'failed', desired_state: 'running' }, ['resume', 'archive', 'remove']],
  [{ state: 'stopped', desired_state: 'stopped' }, ['resume', 'archive', 'remove']],
  [{ state: 'stopped', desired_state: 'stopped', archived_at_unix_s: 1 }, ['unarchive', 'remove']],
];

test.each(OFFERED)('of a run that is %o only what is possible is offered', (run, offered) => {
  const standing = { archived_at_unix_s: null, ...run } as Run;
  expect(ACTIONS.filter((action) => isPossible(action, standing))).toEqual(offered);
});
