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
import { actionName, choicesOf, outputsTaken, softmax, softmaxOfEach } from './policy';
import { linesOf, matches, merge } from './tail';

test('the policy is the softmax of beta P, whatever is added to P', () => {
  expect(softmax([Math.log(1), Math.log(3)], 1)).toEqual(
    [0.25, 0.75].map((p) => expect.closeTo(p)),
  );
  expect(softmax([1000, 1000 + Math.log(3)], 1)[1]).toBeCloseTo(0.75);
  expect(softmax([0, Math.log(3)], 2)[1]).toBeCloseTo(0.9);
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
