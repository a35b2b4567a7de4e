/** Many runs as dots and lines: what the server said of their columns, coloured by one of them. */

import type { RunValues } from '../api/types';
import { ramp, type ThemeName } from '../colour';
import { configValue, number, quantity } from '../format';
import { hrefTo } from '../router';
import type { Dot, ParallelRun } from '../vector/figures';
import { columnTitle, columnUnit } from './columns';
import { RAMPS } from './heatmap';

type Cell = string | number | boolean | null;

/** A value for an axis: truth values are texts. */
export function plotted(cell: Cell | undefined): string | number | null {
  if (cell === null || cell === undefined) return null;
  return typeof cell === 'boolean' ? String(cell) : cell;
}

const PLAIN = 0.55; // of the ramp: what has no number to be coloured by

/** A colour for each run by its rank from lowest to highest value of a column, which no outlier spoils. */
export function colours(cells: readonly (Cell | undefined)[], theme: ThemeName): string[] {
  const values = cells.map((cell) => (typeof cell === 'number' ? cell : null));
  const ordered = [...new Set(values.filter((value) => value !== null))].sort((a, b) => a - b);
  const rank = new Map(ordered.map((value, i) => [value, i]));
  return values.map((value) => {
    const at = value === null ? undefined : rank.get(value);
    const share = at === undefined || ordered.length < 2 ? PLAIN : at / (ordered.length - 1);
    return ramp(RAMPS[theme], 0.25 + 0.75 * share); // the lightest cannot be seen on the page
  });
}

function told(values: RunValues, at: number, columns: readonly string[]): string {
  const parts = columns.map((name) => {
    const cell = values.columns[name]?.[at];
    const text = typeof cell === 'number' ? quantity(cell, columnUnit(name)) : configValue(cell);
    return `${columnTitle(name)} ${text}`;
  });
  return [values.names[at] ?? '', ...parts].join('\n');
}

/** A dot for each run that has values of both columns. */
export function dotsOfRuns(
  values: RunValues,
  { x, y, by }: { x: string; y: string; by: string },
  theme: ThemeName,
): Dot[] {
  const given = colours(values.columns[by] ?? values.ids.map(() => null), theme);
  return values.ids.flatMap((id, i) => {
    const [at, up] = [plotted(values.columns[x]?.[i]), plotted(values.columns[y]?.[i])];
    if (at === null || up === null) return [];
    const title = told(values, i, [...new Set([x, y, by])].filter(Boolean));
    return [{ x: at, y: up, colour: given[i] ?? '', title, href: hrefTo('run', { run: id }) }];
  });
}

/** A line for each run, coloured by the last column. */
export function linesOfRuns(
  values: RunValues,
  columns: readonly string[],
  theme: ThemeName,
): ParallelRun[] {
  const given = colours(values.columns[columns.at(-1) ?? ''] ?? [], theme);
  return values.ids.map((id, i) => ({
    key: id,
    values: columns.map((name) => plotted(values.columns[name]?.[i])),
    colour: given[i] ?? ramp(RAMPS[theme], PLAIN),
    title: told(values, i, columns),
    href: hrefTo('run', { run: id }),
  }));
}

/** The same as a table. */
export function tableOfRuns(
  values: RunValues,
  columns: readonly string[],
): { header: string[]; rows: (string | number | null)[][] } {
  return {
    header: ['run', 'seed', ...columns.map(columnTitle)],
    rows: values.ids.map((_, i) => [
      values.names[i] ?? '',
      values.seeds[i] ?? null,
      ...columns.map((name) => plotted(values.columns[name]?.[i])),
    ]),
  };
}

/** How many of them are shown: nothing to say of all. */
export function shownText(values: RunValues, drawn: number): string {
  const { total, ids } = values;
  const newest =
    ids.length < total ? `the newest ${number(ids.length)} of ${number(total)} runs` : '';
  const without = ids.length - drawn;
  const missing = without > 0 ? `${number(without)} without a value` : '';
  return [newest, missing].filter(Boolean).join(', ');
}
