import fc from 'fast-check';
import { expect, test } from 'vitest';
import { hrefTo, View } from './router';

test('whatever a view holds survives the trip through a URL', () => {
  const unit = fc.constantFrom(...'a1%,&=+?# é\u0000\u{1f916}');
  const texts = fc.string({ minLength: 1, unit });
  fc.assert(
    fc.property(texts, fc.array(texts, { minLength: 1, maxLength: 5 }), (text, list) => {
      const view = View.parse(hrefTo('compare', { search: text, runs: list, log: true }));
      expect(view.page).toBe('compare');
      expect(view.text('search')).toBe(text);
      expect(view.list('runs')).toEqual(list);
      expect(view.flag('log')).toBe(true);
      expect(View.parse(view.href).href).toBe(view.href);
    }),
  );
});

test('what is empty leaves no trace in the URL', () => {
  const view = View.parse('?page=runs&search=a&state=running&archived=1');
  const bare = view.with({ search: '', state: [], archived: false });
  expect(bare.href).toBe('?page=runs');
});

test('values that a page does not know fall back to its default', () => {
  const view = View.parse('?stat=nonsense&range=9,3&smooth=x');
  expect(view.choice('stat', ['mean', 'median'])).toBe('mean');
  expect(view.range('range')).toBeNull();
  expect(view.number('smooth', 0)).toBe(0);
  expect(View.parse('?range=-2.5,1e3').range('range')).toEqual([-2.5, 1000]);
  expect(View.parse('').page).toBe('runs');
});

test('parameters with a prefix come together', () => {
  const view = View.parse('?config.alpha=0.9&config.hidden_units=100&task=pointing');
  expect(view.prefixed('config.')).toEqual({ alpha: '0.9', hidden_units: '100' });
});
