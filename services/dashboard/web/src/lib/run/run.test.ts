import { expect, test } from 'vitest';
import {
  advance,
  changeSpeed,
  currentFrame,
  newPlayback,
  seek,
  SPEEDS,
  step,
  toggle,
} from './playback';
import { actionName, betaOf, choicesOf, outputsTaken, softmax, softmaxOfEach } from './policy';
import { Following } from './following';
import { RunLog } from './log';
import { linesOf, matches, merge, rowsOf } from './tail';

test('the policy is the softmax of beta P, whatever is added to P', () => {
  expect(softmax([Math.log(1), Math.log(3)], 1)).toEqual(
    [0.25, 0.75].map((p) => expect.closeTo(p)),
  );
  expect(softmax([1000, 1000 + Math.log(3)], 1)[1]).toBeCloseTo(0.75);
  expect(softmax([0, Math.log(3)], 2)[1]).toBeCloseTo(0.9);
});

test('beta rises on a line to its factor in the last iteration, and stays', () => {
  const config = { beta: 2, beta_run_final_factor: 3, iterations: 5 };
  expect([0, 2, 4, 5].map((version) => betaOf(config, version))).toEqual([2, 4, 6, 6]);
  expect(betaOf({ beta: 2, iterations: 1 }, 1)).toBe(2);
});

test('an action of several dimensions is one choice in each, and each has a softmax of its own', () => {
  const dims = [3, 2, 4];
  for (let action = 0; action < 24; action += 1) {
    const [a, b, c] = choicesOf(action, dims) as [number, number, number];
    expect(a * 8 + b * 4 + c).toBe(action);
    expect(outputsTaken(action, dims)).toEqual([a, 3 + b, 5 + c]);
  }
  expect(choicesOf(3 ** 20 * 4 - 1, [...Array<number>(20).fill(3), 4])).toEqual([
    ...Array<number>(20).fill(2),
    3,
  ]);
  const shares = softmaxOfEach([0, 0, Math.log(2), 5, 5], 1, [3, 2]);
  expect(shares).toEqual([0.25, 0.25, 0.5, 0.5, 0.5].map((p) => expect.closeTo(p)));
  expect(softmaxOfEach([1, 2, 3], 2, [3])).toEqual(softmax([1, 2, 3], 2));
  expect(actionName(5, ['left', 'right', 'up', 'stay', 'down'], [2, 3])).toBe('right, down');
  expect(actionName(1, [], [2])).toBe('action 1');
});

test('playing shows every frame in its time and stops at the last', () => {
  let playback = toggle(newPlayback(3, 10));
  const shown = [];
  for (let i = 0; i < 5; i += 1) {
    shown.push(currentFrame(playback));
    playback = advance(playback, 0.0501);
  }
  expect(shown).toEqual([0, 0, 1, 1, 2]);
  expect(playback).toMatchObject({ playing: false, position: 2 });
  expect(currentFrame(toggle(playback))).toBe(0); // again from the start
});

test('half speed takes twice the time', () => {
  const playback = { ...toggle(newPlayback(100, 10)), speed: 0.5 };
  expect(currentFrame(advance(playback, 2.01))).toBe(10);
});

test('stepping pauses on whole frames and stays within the episode', () => {
  const playing = advance(toggle(newPlayback(4, 10)), 0.15);
  expect(step(playing, 1)).toMatchObject({ position: 2, playing: false });
  expect(step(seek(playing, 99), 1).position).toBe(3);
  expect(step(seek(playing, -5), -1).position).toBe(0);
});

test('time changes nothing while paused', () => {
  const paused = seek(newPlayback(10, 10), 4);
  expect(advance(paused, 100)).toBe(paused);
});

test('speeds end at both ends', () => {
  let playback = newPlayback(4, 10);
  for (let i = 0; i < 9; i += 1) playback = changeSpeed(playback, 1);
  expect(playback.speed).toBe(SPEEDS.at(-1));
  for (let i = 0; i < 9; i += 1) playback = changeSpeed(playback, -1);
  expect(playback.speed).toBe(SPEEDS[0]);
});

const record = (second: number | null, id: string, level = 'INFO', message = 'text') => ({
  id,
  time_unix_s: second,
  level,
  service: 'edge-0',
  message,
});

test('the tail has every line once, by time, and drops the oldest', () => {
  const live = linesOf([record(4, 'd'), record(5, 'e')]);
  const stored = linesOf([record(1, 'a'), record(2, 'b'), record(3, 'c'), record(4, 'd')]);
  const ids = (longest?: number) => merge(live, stored, longest).map((line) => line.id);
  expect(ids()).toEqual(['a', 'b', 'c', 'd', 'e']);
  expect(ids(3)).toEqual(['c', 'd', 'e']);
});

test('a line without a time stays behind the one before it', () => {
  const lines = linesOf([record(2, 'b'), record(null, 'of b'), record(3, 'c')]);
  const all = merge(linesOf([record(1, 'a'), record(2.5, 'later')]), lines);
  expect(all.map((line) => line.id)).toEqual(['a', 'b', 'of b', 'later', 'c']);
});

test('a line passes by service, severity and text', () => {
  const [warning] = linesOf([record(1, 'a', 'WARNING', 'Frame refused')]);
  const everything = { service: '', level: '', search: '' };
  expect(matches(warning!, everything)).toBe(true);
  expect(matches(warning!, { ...everything, level: 'ERROR' })).toBe(false);
  expect(matches(warning!, { ...everything, level: 'INFO' })).toBe(true);
  expect(matches(warning!, { ...everything, search: 'frame r' })).toBe(true);
  expect(matches(warning!, { ...everything, service: 'learner-0' })).toBe(false);
});

test('every line of a traceback is a row of its own', () => {
  const [traceback] = linesOf([record(1, 'a', 'ERROR', 'failed\nTraceback:\r\n  File "x"\n')]);
  const rows = rowsOf([traceback!]);
  expect(rows.map((row) => row.text)).toEqual(['failed', 'Traceback:', '  File "x"', '']);
  expect(rows.map((row) => row.first)).toEqual([true, false, false, false]);
  expect(new Set(rows.map((row) => row.key)).size).toBe(4);
});

test('a list is followed until the reader moves it, whatever else moves it', () => {
  const reader = new Following();
  expect(reader.scrolled(false, 0)).toBe(true); // lines came: back to the end
  expect(reader.on).toBe(true);
  reader.moved(1000);
  expect(reader.scrolled(false, 1100)).toBe(false);
  expect(reader.on).toBe(false);
  expect(reader.scrolled(true, 5000)).toBe(false); // lines that went made the end come nearer
  expect(reader.on).toBe(false);
  reader.moved(6000);
  reader.scrolled(true, 6100); // the reader went to the end
  expect(reader.on).toBe(true);
  reader.hold(true, 7000);
  reader.scrolled(false, 9000);
  expect(reader.on).toBe(false);
  reader.hold(false, 9000);
  reader.resume();
  expect(reader.scrolled(false, 9100)).toBe(true);
});

test('the server searches the log, page by page until it finds something', async () => {
  const asked: unknown[] = [];
  const pages = [
    { items: [], next_cursor: 'p1', services: ['learner'] },
    { items: [record(3, 'c'), record(2, 'b')], next_cursor: 'p2', services: ['learner'] },
    { items: [record(1, 'a')], next_cursor: null, services: ['learner'] },
  ];
  const log = new RunLog(
    (query) => {
      asked.push(query);
      return Promise.resolve(pages[asked.length - 1]!);
    },
    { service: '', level: 'ERROR', search: 'iteration 0' },
  );
  await log.start();
  expect(asked).toMatchObject([{ level: 'ERROR', search: 'iteration 0' }, { cursor: 'p1' }]);
  const ids = () => log.state.value.lines.map((line) => line.id);
  expect(ids()).toEqual(['b', 'c']);
  expect(log.state.value).toMatchObject({ older: true, loading: false, services: ['learner'] });
  await log.readOlder();
  expect(ids()).toEqual(['a', 'b', 'c']);
  expect(log.state.value.older).toBe(false);
  expect(log.take([record(4, 'd'), record(5, 'e', 'ERROR', 'in iteration 0')])).toBe(1);
  expect(ids()).toEqual(['a', 'b', 'c', 'e']);
});

test('all of the log is saved, not what was loaded', async () => {
  let asked = 0;
  const log = new RunLog(
    () =>
      Promise.resolve({
        items: [record(9 - asked, `l${asked}`)],
        next_cursor: ++asked < 5 ? String(asked) : null,
        services: [],
      }),
    { service: '', level: '', search: '' },
  );
  const { lines, complete } = await log.all(100, () => {});
  expect(lines.map((line) => line.id)).toEqual(['l4', 'l3', 'l2', 'l1', 'l0']);
  expect(complete).toBe(true);
});
