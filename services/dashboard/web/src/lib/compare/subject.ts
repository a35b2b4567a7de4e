/** The runs behind a comparison: what they have in common, and those that were chosen one by one. */

import type { ApiClient } from '../api/client';
import type { Overview, Run } from '../api/types';
import type { Subject } from './view';

export interface SubjectRuns {
  /** Of all of them, however many. */
  overview: Overview;
  /** The chosen ones; none of a filter. */
  chosen: Run[];
  /** The run that is furthest on, whose metrics stand for all. */
  furthest: Run | null;
  /** Ids that the server does not know. */
  unknown: string[];
}

export async function readSubject(
  api: ApiClient,
  subject: Subject,
  signal: AbortSignal,
): Promise<SubjectRuns> {
  if (subject.runs) return readChosen(api, subject.runs, signal);
  const [overview, page] = await Promise.all([
    api.overview(subject.filter, signal),
    api.runs.page({ ...subject.filter, sort: '-iteration', limit: 1 }, signal),
  ]);
  return { overview, chosen: [], furthest: page.items[0] ?? null, unknown: [] };
}

async function readChosen(
  api: ApiClient,
  ids: readonly string[],
  signal: AbortSignal,
): Promise<SubjectRuns> {
  const found = await Promise.allSettled(ids.map((id) => api.runs.get(id, signal)));
  const chosen: Run[] = [];
  const unknown: string[] = [];
  found.forEach((result, i) => {
    if (result.status === 'fulfilled') chosen.push(result.value);
    else if (result.reason?.status === 404) unknown.push(ids[i] ?? '');
    else throw result.reason;
  });
  return { ...ofChosen(chosen), unknown };
}

/** With what was told of chosen runs since they were read. */
export function withNewer(known: SubjectRuns, newer: ReadonlyMap<string, Run>): SubjectRuns {
  return { ...known, ...ofChosen(known.chosen.map((run) => newer.get(run.id) ?? run)) };
}

function ofChosen(chosen: Run[]): Omit<SubjectRuns, 'unknown'> {
  const furthest = chosen.toSorted((a, b) => b.iteration - a.iteration)[0] ?? null;
  return { overview: overviewOf(chosen), chosen, furthest };
}

/** What the server says of a filter's runs, of runs that are at hand. */
export function overviewOf(runs: readonly Run[]): Overview {
  const differing: Overview['differing'] = [];
  const same: Overview['same'] = {};
  const keys = new Set(runs.flatMap((run) => Object.keys(run.config)));
  for (const key of keys) {
    const having = runs.filter((run) => key in run.config);
    const counts = countBy(having, (run) => run.config[key] ?? null);
    const [first] = counts;
    if (counts.size === 1 && having.length === runs.length && first) {
      same[key] = first[0];
      continue;
    }
    const values = [...counts].map(([value, n]) => ({ value, runs: n }));
    values.sort((a, b) => b.runs - a.runs);
    differing.push({ key, distinct: counts.size, values });
  }
  return {
    total: runs.length,
    states: Object.fromEntries(countBy(runs, (run) => run.state)),
    tasks: Object.fromEntries(countBy(runs, (run) => run.task)),
    return_metrics: [...new Set(runs.map((run) => run.summary.returns.metric))].sort(),
    differing,
    same,
  };
}

function countBy<T, K>(items: readonly T[], key: (item: T) => K): Map<K, number> {
  const counts = new Map<K, number>();
  for (const item of items) counts.set(key(item), (counts.get(key(item)) ?? 0) + 1);
  return counts;
}
