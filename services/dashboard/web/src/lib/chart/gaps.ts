/** Holes in lines: values that should be there and are not, such as those of a training that diverged. */

import type { Line } from './plan';

/** Places whose value stands alone: no line leads to it, so that it needs a dot. Undefined: another line's x. */
export function alone(values: ArrayLike<number | null | undefined>): number[] {
  const own = Array.from(values, (value, at) => (value === undefined ? -1 : at)).filter(
    (at) => at >= 0,
  );
  const there = (at: number | undefined): boolean =>
    at !== undefined && values[at] !== null && values[at] !== undefined;
  return own.filter((at, i) => there(at) && !there(own[i - 1]) && !there(own[i + 1]));
}

/** The x from which on a line has no value, though it has points; null: its newest point has one. */
export function noneSince({ x, value }: Pick<Line, 'x' | 'value'>): number | null {
  const last = value.findLastIndex((one) => one !== null && Number.isFinite(one));
  return last === value.length - 1 ? null : (x[last + 1] ?? null);
}
