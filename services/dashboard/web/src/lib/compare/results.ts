/** The results of a comparison in words, rows and marks. */

import type { ComparedGroup, Comparison, ComparisonQuery } from '../api/types';
import { PALETTE, type StrokeBook, type ThemeName } from '../colour';
import { MISSING, number, percent, quantity } from '../format';
import { hrefTo, type View } from '../router';
import type { DotGroup, Interval, ProfileLine } from '../vector/figures';
import { higherIsBetter, METRIC_VALUES } from './columns';
import { groupingOf, subjectQuery, type Subject } from './view';

/** What the address asks for; the first of the return metrics where it names none. */
export function comparisonQuery(
  view: View,
  subject: Subject,
  returns: readonly string[],
): ComparisonQuery {
  const metric = view.text('cm') || returns[0] || null;
  const better = view.text('better');
  const grouping = groupingOf(view, { ...subject, runs: null });
  return {
    ...subjectQuery(subject),
    group_by: view.list('by').length > 0 ? groupingOf(view, subject) : grouping,
    metric,
    value: view.choice('cv', METRIC_VALUES),
    higher_is_better: better ? better === 'higher' : higherIsBetter(metric ?? ''),
    baseline: view.text('base') || null,
  };
}

/** "−310 px [−330, −295]" */
export function intervalText({ value, low, high }: Interval, unit: string): string {
  if (value === null) return MISSING;
  if (low === null || high === null) return quantity(value, unit);
  if (unit === 'share')
    return `${percent(value)} [${number(low * 100, 3)}, ${number(high * 100, 3)}]`;
  return `${quantity(value, unit)} [${number(low)}, ${number(high)}]`;
}

/** How many seeds, and what is wrong with them: "14 runs, 3 seeds", "1 of 4 seeds has no value". */
export function seedsText({ runs, seeds, missing }: ComparedGroup): string {
  const all = seeds + missing;
  const counted = runs > all ? `${runs} runs, ${all} seeds` : `${all} seed${all === 1 ? '' : 's'}`;
  return missing > 0 ? `${counted}, ${missing} without a value` : counted;
}

/** p as papers write it. */
export function pText(p: number): string {
  return p < 0.001 ? '< 0.001' : number(p, 2);
}

export function dotGroups(
  { groups }: Comparison,
  strokes: StrokeBook,
  theme: ThemeName,
): DotGroup[] {
  const given = strokes.assign(groups.map((one) => one.key));
  return groups.map(({ key, label, scores, iqm }) => ({
    key,
    label,
    iqm,
    colour: PALETTE[theme][given.get(key)?.colour ?? 0] ?? '#888888',
    scores: scores.map(({ seed, score, run_ids }) => ({
      seed,
      score,
      href: hrefTo('run', { run: run_ids[0] ?? '' }),
    })),
  }));
}

export function profileLines(
  { groups }: Comparison,
  strokes: StrokeBook,
  theme: ThemeName,
): ProfileLine[] {
  const given = strokes.assign(groups.map((one) => one.key));
  return groups.flatMap(({ key, label, profile }) => {
    if (!profile) return [];
    const stroke = given.get(key);
    const colour = PALETTE[theme][stroke?.colour ?? 0] ?? '#888888';
    return [{ key, label, colour, dash: stroke?.dash ?? [], ...profile }];
  });
}

/** A row for every seed, as it leaves the page. */
export function seedRows({ groups }: Comparison): (string | number | null)[][] {
  return groups.flatMap(({ label, scores }) =>
    scores.map(({ seed, task, score, run_ids }) => [label, task, seed, score, run_ids.join(' ')]),
  );
}
