import fc from 'fast-check';
import { expect, test } from 'vitest';
import { contrast, PALETTE, ramp, StrokeBook, type KeyStorage } from './colour';

const BACKGROUNDS = { light: '#ffffff', dark: '#16191c' };

test.each(['light', 'dark'] as const)('lines keep 3:1 against the %s background', (theme) => {
  for (const colour of PALETTE[theme]) {
    expect(contrast(colour, BACKGROUNDS[theme]), colour).toBeGreaterThanOrEqual(3);
  }
});

test('contrast is that of WCAG', () => {
  expect(contrast('#000000', '#ffffff')).toBeCloseTo(21, 10);
  expect(contrast('#777777', '#ffffff')).toBeCloseTo(4.48, 2);
});

const keys = fc.uniqueArray(fc.string(), { minLength: 1, maxLength: 32 });

test('lines shown together differ in colour or dash, whatever their order', () => {
  fc.assert(
    fc.property(keys, (shown) => {
      const strokes = new StrokeBook().assign(shown);
      const looks = new Set([...strokes.values()].map(({ colour, dash }) => `${colour} ${dash}`));
      expect(looks.size).toBe(shown.length);
      const again = new StrokeBook().assign([...shown].reverse());
      for (const key of shown) expect(again.get(key)).toEqual(strokes.get(key));
    }),
  );
});

test('few lines have colours of which no two are alike: one blue, one of orange, ochre and yellow', () => {
  const few = fc.uniqueArray(fc.string(), { minLength: 2, maxLength: 5 });
  fc.assert(
    fc.property(few, (shown) => {
      const colours = [...new StrokeBook().assign(shown).values()].map(({ colour }) => colour);
      expect(colours.filter((colour) => [4, 5, 7].includes(colour))).toEqual([]);
    }),
  );
});

test('filtering changes no stroke', () => {
  fc.assert(
    fc.property(keys, fc.func(fc.boolean()), (shown, keep) => {
      const book = new StrokeBook();
      const before = book.assign(shown);
      const after = book.assign(shown.filter((key) => keep(key)));
      for (const [key, stroke] of after) expect(stroke).toEqual(before.get(key));
    }),
  );
});

test('strokes and choices are kept; what is damaged is forgotten', () => {
  const kept = new Map<string, string>();
  const storage: KeyStorage = {
    getItem: (name) => kept.get(name) ?? null,
    setItem: (name, text) => void kept.set(name, text),
  };
  new StrokeBook(storage).choose('alpha 0.9', 5);
  expect(new StrokeBook(storage).assign(['alpha 0.9']).get('alpha 0.9')?.colour).toBe(5);
  for (const damaged of ['{', '[["a", 99], ["b", "c"], 7]', 'null']) {
    kept.set('bpn.strokes', damaged);
    expect(new StrokeBook(storage).assign(['a']).size).toBe(1);
  }
});

test('a chosen colour is given, and no two lines look alike because of it', () => {
  fc.assert(
    fc.property(keys, fc.nat(), fc.nat({ max: 7 }), (shown, pick, colour) => {
      const book = new StrokeBook();
      book.assign(shown);
      const key = shown[pick % shown.length] ?? '';
      book.choose(key, colour, shown);
      expect(book.choices.value).toBe(1);
      const strokes = book.assign(shown);
      expect(strokes.get(key)).toEqual({ colour, dash: [] });
      const looks = new Set([...strokes.values()].map((one) => `${one.colour} ${one.dash}`));
      expect(looks.size).toBe(shown.length);
    }),
  );
});

test('a ramp begins and ends with its ends', () => {
  expect(ramp(['#000000', '#102030'], 0)).toBe('#000000');
  expect(ramp(['#000000', '#102030'], 1)).toBe('#102030');
  expect(ramp(['#000000', '#102030'], 0.5)).toBe('#081018');
});
