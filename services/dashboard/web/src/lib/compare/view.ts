/** What the compare page shows, as the URL says it. */

import { runQuery } from '../api/client';
import type { Band, RunQuery, SeriesQuery, Statistic, XAxis } from '../api/types';
import { principalOf } from '../metrics';
import type { View } from '../router';
import { ALL_BUT_SEED } from '../runs/groups';
import { filterOf } from '../runs/query';

export const TABS = [
  'curves',
  'results',
  'scatter',
  'parallel',
  'configuration',
  'heatmap',
] as const;
export const STATISTICS: readonly [Statistic, ...Statistic[]] = ['mean', 'median', 'iqm'];
export const BANDS: readonly [Band, ...Band[]] = ['std', 'sem', 'ci95', 'minmax'];
export const AXES: readonly [XAxis, ...XAxis[]] = [
  'iteration',
  'process_s',
  'wall_s',
  'transitions',
];
export const EACH_RUN = 'run';

export const STATISTIC_TITLES: Record<Statistic, string> = {
  mean: 'mean',
  median: 'median',
  iqm: 'interquartile mean',
};
export const BAND_TITLES: Record<Band, string> = {
  std: '± standard deviation',
  sem: '± standard error',
  ci95: '95% confidence',
  minmax: 'lowest to highest',
};
export const AXIS_TITLES: Record<XAxis, string> = {
  iteration: 'iteration',
  process_s: 'time worked',
  wall_s: 'time since the start',
  transitions: 'transitions',
};
export const AXIS_UNITS: Record<XAxis, string> = {
  iteration: '',
  process_s: 's',
  wall_s: 's',
  transitions: '',
};

/** Chosen runs, or all runs that meet a filter. */
export interface Subject {
  runs: string[] | null;
  filter: RunQuery;
}

export function subjectOf(view: View): Subject | null {
  const runs = view.list('runs');
  const filter = filterOf(view);
  if (runs.length > 0) return { runs, filter: {} };
  return Object.keys(filter).length > 0 ? { runs: null, filter } : null;
}

/** How runs become lines: chosen ones stand for themselves, many are gathered over seeds, unless the URL says else. */
export function groupingOf(view: View, subject: Subject): SeriesQuery['group_by'] {
  const by = view.list('by');
  if (by[0] === EACH_RUN) return null;
  if (by[0] === ALL_BUT_SEED) return ALL_BUT_SEED;
  if (by.length > 0) return by;
  return subject.runs ? null : ALL_BUT_SEED;
}

/** The metrics that the URL names, or those that runs with these return metrics open with. */
export function metricsOf(view: View, returns: readonly string[]): string[] {
  const metrics = view.list('metrics');
  return metrics.length > 0 ? metrics : principalOf(...returns);
}

/** The part of a series query that all charts of the page share. */
export type SharedQuery = Omit<SeriesQuery, 'metrics' | 'max_points' | 'max_groups'>;

/** Of which runs, as bodies of requests have it. */
export function subjectQuery(subject: Subject): {
  runs?: string[];
  filter?: Record<string, string | boolean>;
} {
  return subject.runs ? { runs: subject.runs } : { filter: filterBody(subject.filter) };
}

export function sharedQuery(view: View, subject: Subject): SharedQuery {
  return {
    ...subjectQuery(subject),
    group_by: groupingOf(view, subject),
    x: view.choice('x', AXES),
    range: view.range('range'),
    statistic: view.choice('stat', STATISTICS),
    band: view.choice('band', BANDS),
  };
}

/** A filter as the body of a request has it: the names of the query string. */
function filterBody(filter: RunQuery): Record<string, string | boolean> {
  return runQuery(filter) as Record<string, string | boolean>;
}
