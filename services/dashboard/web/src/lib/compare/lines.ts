/** Curves of the server as lines of a chart. */

import type { Column, Series } from '../api/types';
import type { Line } from '../chart/plan';
import type { StrokeBook } from '../colour';
import { countOf } from '../statistics';

export interface Labels {
  /** What a run is called. */
  run: (id: string) => string;
}

/**
 * Lines with strokes that stay with their group.
 *
 * The band is the statistic's; of single runs whose points were put in buckets, it is what the buckets span.
 */
export function linesOf(series: readonly Series[], strokes: StrokeBook, labels: Labels): Line[] {
  const given = strokes.assign(series.map((one) => one.key));
  return series.map((one) => {
    const single = one.run_ids.length === 1 && Object.keys(one.group).length === 0;
    const [low, high] = single ? (one.bucket > 0 ? [one.min, one.max] : []) : [one.low, one.high];
    return {
      key: one.key,
      label: single ? labels.run(one.run_ids[0] ?? '') || one.label : groupName(one),
      stroke: given.get(one.key) ?? { colour: 0, dash: [] },
      x: one.x,
      value: one.value,
      ...(low && high ? { low, high } : {}),
      ...(single ? {} : { n: one.n }),
      ...(one.run_ids.length > one.seeds
        ? { repeats: countOf(one.run_ids.length, one.seeds) }
        : {}),
    };
  });
}

/**
 * The lines less the one of a key, as far as that goes: where it has no value at an x, its newest one before counts.
 * Without a line of that key they stay as they are.
 */
export function differenceTo(lines: readonly Line[], key: string): Line[] {
  const base = lines.find((line) => line.key === key);
  if (!base) return [...lines];
  const last = base.x.at(-1) ?? -Infinity;
  return lines.map((line) => {
    let at = -1;
    const shift = line.x.map((x) => {
      if (x === null || x > last) return null;
      while (at + 1 < base.x.length && (base.x[at + 1] ?? Infinity) <= x) at += 1;
      return base.value[at] ?? null;
    });
    const less = (column: Column): Column =>
      column.map((value, i) => {
        const by = shift[i] ?? null;
        return value === null || by === null ? null : value - by;
      });
    return {
      ...line,
      value: less(line.value),
      ...(line.low && line.high ? { low: less(line.low), high: less(line.high) } : {}),
    };
  });
}

function groupName({ label, group, run_ids, seeds }: Series): string {
  const parts = Object.entries(group).map(([key, value]) => `${key} ${String(value)}`);
  return parts.join(', ') || label || countOf(run_ids.length, seeds);
}
