import { expect, test } from 'vitest';
import { planOf, type Line } from './plan';
import { vectorOf, type Plotted } from './vector';

const INK = { text: '#000000', muted: '#555555', line: '#dddddd', background: '#ffffff' };
const LINES: Line[] = [
  {
    key: 'a',
    label: 'first',
    stroke: { colour: 0, dash: [2, 3] },
    x: [0, 1, 2, 3, 4],
    value: [1, 2, null, 1000, 2],
    low: [0, 1, null, 900, 1],
    high: [2, 3, null, 1100, 3],
  },
  { key: 'b', label: 'second', stroke: { colour: 1, dash: [] }, x: [0, 4], value: [5, 6] },
];

function plotted(change: Partial<Plotted> = {}): Plotted {
  return {
    widthPx: 300,
    heightPx: 200,
    frame: { left: 50, top: 10, right: 290, bottom: 170 },
    x: { low: 0, high: 4, at: (v) => 50 + 60 * v, text: String },
    y: { low: 0, high: 10, at: (v) => 170 - 16 * v, text: String },
    distribution: 'linear',
    plan: planOf(LINES, 0),
    lines: LINES,
    hidden: new Set(),
    colour: (line) => ['#111111', '#222222'][line] ?? '',
    bandAlpha: 0.2,
    rawAlpha: 0.3,
    ...change,
  };
}

function strokes(drawing: ReturnType<typeof vectorOf>, colour: string) {
  return drawing.marks.filter(
    (mark) => mark.kind === 'path' && mark.stroke === colour && mark.width === 1.75,
  );
}

test('a hole is a hole, values beyond the range stop at its edge, and names stand below', () => {
  const drawing = vectorOf(plotted(), INK);
  const [before, after] = strokes(drawing, '#111111');
  expect(before).toMatchObject({ points: [[50, 154], [110, 138]], dash: [2, 3] }); // prettier-ignore
  expect(after).toMatchObject({ points: [[230, 10], [290, 138]] }); // prettier-ignore
  expect(strokes(drawing, '#222222')).toHaveLength(1);
  expect(drawing.marks.filter((mark) => mark.kind === 'path' && mark.fill === '#111111')).toHaveLength(2);
  const names = drawing.marks.filter((mark) => mark.kind === 'text').map((mark) => mark.text);
  expect(names).toEqual(expect.arrayContaining(['first', 'second']));
  expect(drawing.height).toBeGreaterThan(200);
}); // prettier-ignore

test('what is hidden is not in the file', () => {
  const drawing = vectorOf(plotted({ hidden: new Set(['a']) }), INK);
  expect(strokes(drawing, '#111111')).toHaveLength(0);
  expect(JSON.stringify(drawing)).not.toContain('first');
});

test('a logarithmic axis has its decades, on both sides of 0 where it is symmetric', () => {
  const y = { low: -100, high: 100, at: (v: number) => 90 - v / 2, text: String };
  const drawing = vectorOf(plotted({ y, distribution: 'symlog' }), INK);
  const texts = drawing.marks.filter((mark) => mark.kind === 'text').map((mark) => mark.text);
  expect(texts).toEqual(expect.arrayContaining(['-100', '-10', '0', '10', '100']));
});
