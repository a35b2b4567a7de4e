import { expect, test, vi } from 'vitest';
import { asProblem, Problem, problemOf } from './api/problem';
import { Keyboard } from './keyboard';
import { onReconnect } from './live/reconnect';
import type { ConnectionStatus } from './live/client';
import { evaluatedOf, metricNamed, principalOf, returnOf } from './metrics';
import { Value } from './observable';
import { tokenIn } from './session';
import { Toasts } from './toasts';

function press(keyboard: Keyboard, key: string, timeStamp: number, target: object = {}): void {
  const event = { key, timeStamp, target, defaultPrevented: false, preventDefault: () => {} };
  keyboard.press(event as unknown as KeyboardEvent);
}

test('shortcuts of one key and of two, not while typing', () => {
  const keyboard = new Keyboard({ addEventListener: () => {} });
  const done: string[] = [];
  const shortcut = (keys: string) => ({
    keys,
    does: '',
    where: '',
    run: () => void done.push(keys),
  });
  const remove = keyboard.add(shortcut('r'), shortcut('g r'), shortcut('x'));
  press(keyboard, 'g', 0);
  press(keyboard, 'r', 500);
  press(keyboard, 'r', 600);
  press(keyboard, 'g', 1000);
  press(keyboard, 'r', 9000); // too late to be one with g
  press(keyboard, 'x', 9100, { tagName: 'INPUT', type: 'text' });
  press(keyboard, 'x', 9200, { tagName: 'INPUT', type: 'checkbox' });
  press(keyboard, 'x', 9300, { closest: () => ({}) }); // inside a dialog
  expect(done).toEqual(['g r', 'r', 'r', 'x']);
  remove();
  press(keyboard, 'x', 9400);
  expect(done).toHaveLength(4);
});

test('an observable tells its value at once and every change once', () => {
  const value = new Value(1);
  const heard: number[] = [];
  const stop = value.subscribe((one) => heard.push(one));
  value.set(2);
  value.set(2);
  stop();
  value.set(3);
  expect(heard).toEqual([1, 2]);
});

test('a token is found in what was pasted', () => {
  expect(tokenIn(' http://127.0.0.1:8000/#token=bpn_a-b_c \n')).toBe('bpn_a-b_c');
  expect(tokenIn('  bpn_a-b_c ')).toBe('bpn_a-b_c');
});

test('problems are read as the server writes them, and otherwise by status', async () => {
  const body = {
    type: 'urn:bpn:problem:invalid-request',
    title: 'Unprocessable Content',
    detail: 'the request has wrong values',
    errors: [
      { location: 'body.config.alpha', message: 'must be at most 1' },
      { location: 'body.seeds', message: 'too many' },
      'nonsense',
    ],
  };
  const problem = await problemOf(new Response(JSON.stringify(body), { status: 422 }));
  expect(problem).toMatchObject({ status: 422, type: body.type, detail: body.detail });
  expect(problem.fields).toEqual([
    { field: 'alpha', message: 'must be at most 1' },
    { field: 'seeds', message: 'too many' },
  ]);
  const bare = new Response('<html>', { status: 502, statusText: 'Bad Gateway' });
  expect(await problemOf(bare)).toMatchObject({ status: 502, title: 'Bad Gateway' });
  expect(asProblem(problem)).toBe(problem);
  expect(asProblem(new Error('oops')).detail).toContain('oops');
});

test('reading again follows every reconnection, not the first connection', () => {
  const connection = new Value<ConnectionStatus | null>(null);
  const read = vi.fn();
  const stop = onReconnect(connection, read);
  const be = (state: ConnectionStatus['state']) =>
    connection.set({ state, lostAtMs: null, retryAtMs: null, roundTripMs: null });
  be('connecting');
  be('online');
  expect(read).not.toHaveBeenCalled();
  be('offline');
  be('connecting');
  be('online');
  be('online');
  expect(read).toHaveBeenCalledTimes(1);
  stop();
  be('offline');
  be('online');
  expect(read).toHaveBeenCalledTimes(1);
});

test('messages with an undo stay at least ten seconds, problems until they are dismissed', () => {
  const toasts = new Toasts();
  toasts.done('saved');
  toasts.done('archived', () => {});
  toasts.failed('not saved', new Problem(409, 'Conflict', 'somebody else did'));
  toasts.failed('not read', new Problem(401, 'Unauthorized'));
  const [saved, archived, failed] = toasts.all.value;
  expect(toasts.all.value).toHaveLength(3);
  expect(saved?.action).toBeNull();
  expect(archived?.forMs).toBeGreaterThanOrEqual(10_000);
  expect(failed).toMatchObject({ detail: 'Conflict: somebody else did', forMs: Infinity });
  toasts.dismiss(saved!.id);
  expect(toasts.all.value).toEqual([archived, failed]);
});

test('metrics have units, unknown ones by the end of their name', () => {
  for (const name of principalOf('return_px', 'return'))
    expect(metricNamed(name).title).not.toBe(name);
  expect(metricNamed('edge.inference_us.p50').unit).toBe('µs');
  expect(metricNamed('rss_bytes').unit).toBe('bytes');
  expect(metricNamed('something').unit).toBe('');
});

test('returns are in pixels unless a Gymnasium environment is among the tasks', () => {
  expect(returnOf('return_px', 'return_px').unit).toBe('px');
  expect(returnOf('return_px', 'return').unit).toBe('');
  expect(principalOf('return', 'return')[0]).toBe('return');
  expect(principalOf('return')).not.toContain('return_px');
});

test('a run that is evaluated opens with its evaluations, of success where tasks define it', () => {
  expect(evaluatedOf('return_px', { evaluate_every: 0 })).toEqual([]);
  expect(evaluatedOf('return_px', { evaluate_every: 5 })).toEqual(['eval_return', 'eval_success']);
  expect(evaluatedOf('return', { evaluate_every: 5 })).toEqual(['eval_return']);
});
