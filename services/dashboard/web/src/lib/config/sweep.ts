/** Sweeps: the values to try of each key, as somebody types them. */

import type { ConfigValue } from '../api/types';
import { parseValue, type Field } from './form';

export const MOST_RUNS = 1000;

export interface Axis {
  key: string;
  text: string; // "0.5, 0.9, 0.95" or "0-9"
}

/** What values are separated by: texts may have commas and spaces in them. */
export function separatorOf(field: Field | undefined): RegExp {
  return field?.kind === 'text' ? /\s*;\s*/ : /[\s,]+/;
}

/** The values in a text (`separatorOf`); `a-b` counts whole numbers from a to b. */
export function parseValues(
  field: Field,
  text: string,
): { values: ConfigValue[] } | { wrong: string } {
  const values: ConfigValue[] = [];
  for (const part of text.trim().split(separatorOf(field)).filter(Boolean)) {
    const range = field.kind === 'integer' ? /^(\d+)(?:-|\.\.)(\d+)$/.exec(part) : null;
    const [from, to] = [Number(range?.[1]), Number(range?.[2])];
    if (range && (from > to || to - from >= MOST_RUNS)) {
      return { wrong: `${part}: must rise, and by less than ${MOST_RUNS}` };
    }
    const texts = range
      ? Array.from({ length: to - from + 1 }, (_, i) => String(from + i))
      : [part];
    for (const one of texts) {
      const parsed = parseValue(field, one);
      if ('wrong' in parsed) return { wrong: `${one} ${parsed.wrong}` };
      if (values.includes(parsed.value)) return { wrong: `${one} stands twice` };
      values.push(parsed.value);
    }
  }
  return values.length > 0 ? { values } : { wrong: 'needs at least one value' };
}

/** How many runs a sweep has. */
export function runsOf(valuesPerAxis: readonly number[], seeds: number): number {
  return valuesPerAxis.reduce((product, n) => product * n, Math.max(1, seeds));
}
