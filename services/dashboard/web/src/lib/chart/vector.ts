/** A chart as it stands, as a drawing: the same scales, ranges and colours, and a legend below. */

import { ticksOf } from '../vector/axes';
import { area, label, line, type Drawing, type Ink, type Mark } from '../vector/drawing';
import type { Line, Plan } from './plan';
import type { Distribution } from './scale';

/** What of a chart a drawing needs; places are pixels of the picture. */
export interface Plotted {
  widthPx: number;
  heightPx: number;
  frame: { left: number; top: number; right: number; bottom: number };
  x: { low: number; high: number; at: (value: number) => number; text: (value: number) => string };
  y: { low: number; high: number; at: (value: number) => number; text: (value: number) => string };
  distribution: Distribution;
  plan: Plan;
  lines: readonly Line[];
  hidden: ReadonlySet<string>;
  colour: (line: number) => string;
  bandAlpha: number;
  rawAlpha: number;
}

const LEGEND_ROW_PX = 20;
const SWATCH_PX = 18;
const LETTER_PX = 6.6;

export function vectorOf(plotted: Plotted, ink: Ink): Drawing {
  const { frame, plan, lines, hidden } = plotted;
  const inside = plan.series.map(({ line: of }) => !hidden.has(lines[of]?.key ?? ''));
  const marks: Mark[] = [...grid(plotted, ink)];
  for (const { series, line: of } of plan.bands) {
    const [high, low] = series.map((column) => pieces(plotted, column));
    if (!inside[series[0] - 1]) continue;
    high?.forEach((piece, i) => {
      const back = [...(low?.[i] ?? [])].reverse();
      marks.push(area([...piece, ...back], plotted.colour(of), plotted.bandAlpha));
    });
  }
  plan.series.forEach(({ line: of, part }, i) => {
    if (!inside[i] || part === 'low' || part === 'high') return;
    const raw = part === 'raw';
    for (const piece of pieces(plotted, i + 1)) {
      marks.push(
        line(piece, plotted.colour(of), raw ? 1 : 1.75, {
          dash: raw ? [] : [...(lines[of]?.stroke.dash ?? [])],
          ...(raw ? { alpha: plotted.rawAlpha } : {}),
        }),
      );
    }
  });
  const legend = legendOf(plotted, ink);
  return {
    width: plotted.widthPx,
    height: plotted.heightPx + 8 + LEGEND_ROW_PX * legend.rows,
    background: ink.background,
    marks: [...marks, ...legend.marks],
  };

  /** The lines' names, as many beside each other as there is room for. */
  function legendOf(
    { widthPx, heightPx }: Plotted,
    { text }: Ink,
  ): { rows: number; marks: Mark[] } {
    const found: Mark[] = [];
    let [x, row] = [frame.left, 0];
    lines.forEach(({ label: name, key, stroke }, i) => {
      if (hidden.has(key)) return;
      const width = SWATCH_PX + 6 + name.length * LETTER_PX + 16;
      if (x > frame.left && x + width > widthPx) [x, row] = [frame.left, row + 1];
      const y = heightPx + 12 + LEGEND_ROW_PX * row;
      found.push(
        line([[x, y - 4], [x + SWATCH_PX, y - 4]], plotted.colour(i), 2.5, { dash: [...stroke.dash] }),
        label(x + SWATCH_PX + 6, y, name, text),
      ); // prettier-ignore
      x += width;
    });
    return { rows: found.length > 0 ? row + 1 : 0, marks: found };
  }
}

function grid({ frame, x, y, distribution }: Plotted, ink: Ink): Mark[] {
  const marks: Mark[] = [];
  for (const tick of ticksOf(x.low, x.high, 7)) {
    const at = x.at(tick);
    marks.push(
      line([[at, frame.top], [at, frame.bottom]], ink.line),
      label(at, frame.bottom + 16, x.text(tick), ink.muted, { anchor: 'middle' }),
    ); // prettier-ignore
  }
  for (const tick of distribution === 'linear' ? ticksOf(y.low, y.high, 5) : decades(y)) {
    const at = y.at(tick);
    marks.push(
      line([[frame.left, at], [frame.right, at]], ink.line),
      label(frame.left - 6, at + 4, y.text(tick), ink.muted, { anchor: 'end' }),
    ); // prettier-ignore
  }
  return marks;
}

/** Powers of ten in a range, of both signs, and zero. */
function decades({ low, high }: { low: number; high: number }): number[] {
  const largest = Math.max(Math.abs(low), Math.abs(high));
  const powers = Array.from({ length: 12 }, (_, i) => 10 ** (Math.floor(Math.log10(largest)) - i));
  const all = [...powers.map((power) => -power), 0, ...powers];
  return all.filter((tick) => tick >= low && tick <= high);
}

/** A column's points in runs without a hole; beyond the frame they are put on its edge. */
function pieces({ plan, x, y, frame }: Plotted, column: number): [number, number][][] {
  const xs = plan.columns[0] ?? [];
  const values = plan.columns[column] ?? [];
  const found: [number, number][][] = [];
  let open = false;
  for (let i = 0; i < xs.length; i++) {
    const [at, value] = [xs[i], values[i]];
    if (value === undefined) continue; // another line's x
    if (value === null || at === null || at === undefined || at < x.low || at > x.high) {
      open = false;
      continue;
    }
    if (!open) found.push([]);
    open = true;
    const height = Math.min(Math.max(y.at(value), frame.top), frame.bottom);
    found.at(-1)?.push([x.at(at), height]);
  }
  return found;
}
