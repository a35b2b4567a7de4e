import { expect, test } from 'vitest';
import { mayReload } from './reload';

test('a page is read anew once, and again only much later', () => {
  const kept = new Map<string, string>();
  const storage = {
    getItem: (name: string) => kept.get(name) ?? null,
    setItem: (name: string, text: string) => void kept.set(name, text),
  };
  expect(mayReload(storage, 1e12)).toBe(true);
  expect(mayReload(storage, 1e12 + 5000)).toBe(false);
  expect(mayReload(storage, 1e12 + 3_600_000)).toBe(true);
});
