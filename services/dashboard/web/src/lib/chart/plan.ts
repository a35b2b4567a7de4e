/** From lines as the server answers them to what uPlot draws: one x for all, bands, raw behind smooth. */

import type { Column } from '../api/types';
import type { Stroke } from '../colour';
import { debiasedEma } from '../statistics';

/** One line of a chart. Columns are as long as `x`; null is a value that is not there. */
export interface Line {
  key: string; // what it is, over updates: a run's id, or a group
  label: string;
  stroke: Stroke;
  x: readonly (number | null)[];
  value: Column;
  low?: Column;
  high?: Column;
  n?: Column; // how many seeds stand behind a point
  repeats?: string; // "14 runs, 3 seeds", where seeds were run more than once
}

export type Part = 'low' | 'high' | 'raw' | 'value';

export interface PlannedSeries {
  line: number; // index of the line that it belongs to
  part: Part;
}

/** `columns[0]` is x; `columns[i + 1]` belongs to `series[i]`. Undefined: the line has no point at that x. */
export interface Plan {
  columns: (number | null | undefined)[][];
  series: PlannedSeries[];
  bands: { series: [number, number]; line: number }[]; // columns of high and low
  mainColumn: number[]; // of each line, the column that is read out
}

export function planOf(lines: readonly Line[], smoothing: number): Plan {
  const x = commonX(lines);
  const plan: Plan = { columns: [x], series: [], bands: [], mainColumn: [] };
  const add = (line: number, part: Part, values: Column): number => {
    plan.series.push({ line, part });
    return plan.columns.push(aligned(x, lines[line]?.x ?? [], values)) - 1;
  };
  lines.forEach(({ low, high }, line) => {
    if (!low || !high) return;
    const columnOfHigh = add(line, 'high', high);
    plan.bands.push({ series: [columnOfHigh, add(line, 'low', low)], line });
  });
  if (smoothing > 0) lines.forEach(({ value }, line) => add(line, 'raw', value));
  lines.forEach(({ value }, line) =>
    plan.mainColumn.push(add(line, 'value', debiasedEma(value, smoothing))),
  );
  return plan;
}

/** Equal for plans that differ in numbers only, so that a chart can be kept and given new data. */
export function shapeOf(lines: readonly Line[], smoothing: number): string {
  const shapes = lines.map(({ key, stroke, low }) => [
    key,
    stroke.colour,
    stroke.dash.join('.'),
    Boolean(low),
  ]);
  return JSON.stringify([smoothing > 0, shapes]);
}

function commonX(lines: readonly Line[]): number[] {
  const first = lines[0]?.x ?? [];
  if (lines.every(({ x }) => sameX(x, first))) return first.filter((value) => value !== null);
  const all = new Set<number>();
  for (const { x } of lines) for (const value of x) if (value !== null) all.add(value);
  return Float64Array.from(all).sort() as unknown as number[];
}

function sameX(one: readonly (number | null)[], other: readonly (number | null)[]): boolean {
  return (
    one === other || (one.length === other.length && one.every((value, i) => value === other[i]))
  );
}

function aligned(
  x: ArrayLike<number>,
  lineX: readonly (number | null)[],
  values: Column,
): (number | null | undefined)[] {
  if (x.length === lineX.length && lineX.every((value, i) => value === x[i])) return values;
  const result = new Array<number | null | undefined>(x.length).fill(undefined);
  let at = 0;
  lineX.forEach((value, i) => {
    if (value === null) return;
    while (at < x.length && (x[at] ?? Infinity) < value) at += 1;
    if (x[at] === value) result[at] = values[i] ?? null;
  });
  return result;
}
