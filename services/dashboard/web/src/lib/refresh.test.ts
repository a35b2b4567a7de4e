import { afterEach, beforeEach, expect, test, vi } from 'vitest';
import { Refresh } from './refresh';

beforeEach(() => void vi.useFakeTimers());
afterEach(() => void vi.useRealTimers());

test('requests while loading make exactly one more load', async () => {
  const finish: (() => void)[] = [];
  const refresh = new Refresh(() => new Promise((resolve) => finish.push(resolve)), 100);
  refresh.request();
  refresh.request();
  refresh.request();
  expect(finish).toHaveLength(1);
  finish[0]!();
  await vi.advanceTimersByTimeAsync(1000);
  expect(finish).toHaveLength(2);
  finish[1]!();
  await vi.advanceTimersByTimeAsync(1000);
  expect(finish).toHaveLength(2);
});

test('loads are at least so far apart, and the last request is not forgotten', async () => {
  let loads = 0;
  const refresh = new Refresh(async () => void (loads += 1), 100);
  for (let ms = 0; ms < 1000; ms += 10) {
    refresh.request();
    await vi.advanceTimersByTimeAsync(10);
  }
  await vi.advanceTimersByTimeAsync(1000);
  expect(loads).toBe(11);
});

test('stopping ends what is under way and what waits', async () => {
  const signals: AbortSignal[] = [];
  const refresh = new Refresh(async (signal) => void signals.push(signal), 100);
  refresh.request();
  refresh.request();
  refresh.stop();
  await vi.advanceTimersByTimeAsync(1000);
  expect(signals).toHaveLength(1);
  expect(signals[0]!.aborted).toBe(true);
});
