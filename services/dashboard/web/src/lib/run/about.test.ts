import { expect, test } from 'vitest';
import { changesOf, rebased } from './about';

const BEFORE = { name: 'a', notes: 'n', tags: ['t'] };

test('only what was changed is sent', () => {
  expect(changesOf(BEFORE, { ...BEFORE, name: 'b' })).toEqual({ name: 'b' });
  expect(changesOf(BEFORE, { ...BEFORE, tags: ['t', 'u'] })).toEqual({ tags: ['t', 'u'] });
  expect(changesOf(BEFORE, { ...BEFORE })).toEqual({});
});

test('a changed name does not undo the notes of somebody else', () => {
  const theirs = { ...BEFORE, notes: 'theirs' };
  const { mine, conflicts } = rebased(BEFORE, { ...BEFORE, name: 'b' }, theirs);
  expect(mine).toEqual({ name: 'b', notes: 'theirs', tags: ['t'] });
  expect(conflicts).toEqual([]);
  expect(changesOf(theirs, mine)).toEqual({ name: 'b' });
});

test('where both changed the same, neither is lost without a word', () => {
  const mine = { ...BEFORE, notes: 'mine', tags: ['u'] };
  const result = rebased(BEFORE, mine, { ...BEFORE, notes: 'theirs', tags: ['u'] });
  expect(result).toEqual({ mine, conflicts: ['notes'] });
});
