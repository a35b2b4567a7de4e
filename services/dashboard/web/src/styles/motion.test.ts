import { readFileSync } from 'node:fs';
import { expect, test } from 'vitest';

const base = readFileSync(new URL('./base.css', import.meta.url), 'utf8');
const reduced = /@media \(prefers-reduced-motion: reduce\) \{([\s\S]*?\n)\}/.exec(base)?.[1] ?? '';

test('who asks for less motion gets styles at once, not transitions of a short duration', () => {
  expect(reduced).toContain('animation: none !important');
  expect(reduced).toContain('transition: none !important');
  expect(reduced).not.toMatch(/(transition|animation)-duration/);
});
