import fc from 'fast-check';
import { expect, test } from 'vitest';
import { changeOf, quoted, tagColour, tagQuery, toggledCondition } from './tags';

test('a value that is more than a word is put in quotes, and nothing ends them early', () => {
  expect([quoted('paper'), quoted('größe'), quoted('a b'), quoted('a"b\\')]).toEqual([
    'paper',
    'größe',
    '"a b"',
    '"a\\"b\\\\"',
  ]);
  fc.assert(
    fc.property(fc.string({ minLength: 1 }), (text) => {
      const found = quoted(text);
      if (found.startsWith('"')) expect(found.slice(1, -1).replace(/\\(.)/gs, '$1')).toBe(text);
      else expect(found).toBe(text);
    }),
  );
});

test('a condition is added to a query and taken out again', () => {
  const paper = tagQuery('paper');
  expect(toggledCondition('', paper)).toBe('tag:paper');
  expect(toggledCondition('alpha>0.5', paper)).toBe('alpha>0.5 and tag:paper');
  expect(toggledCondition('a or b', paper)).toBe('(a or b) and tag:paper');
  for (const query of ['', 'alpha>0.5']) {
    expect(toggledCondition(toggledCondition(query, paper), paper)).toBe(query);
  }
});

test('a tag keeps its colour, and changes are what was touched alone', () => {
  expect(tagColour('paper', 'dark')).toBe(tagColour('paper', 'dark'));
  expect(changeOf(new Map([['a', true], ['b', false]]))).toEqual({ add: ['a'], remove: ['b'] }); // prettier-ignore
});
