/** The list of runs as the URL says it: filters, order, grouping, columns. */

import type { RunQuery } from '../api/types';
import type { Changes, View } from '../router';

export const STATES = [
  'queued',
  'running',
  'stopping',
  'finished',
  'failed',
  'stopped',
  'lost',
] as const;
export const CONFIG_PREFIX = 'config.';
export const NEWEST_FIRST = '-created_at';

/** The part of a view that chooses runs; the same names wherever runs are chosen. */
export function filterOf(view: View): RunQuery {
  const query: RunQuery = {};
  const search = view.text('search');
  if (search) query.search = search;
  const words = view.text('query');
  if (words) query.query = words;
  const states = view.list('state');
  if (states.length > 0) query.state = states.join(',');
  for (const key of ['task', 'algorithm', 'sweep_id'] as const) {
    const value = view.text(key);
    if (value) query[key] = value;
  }
  const config = view.prefixed(CONFIG_PREFIX);
  if (Object.keys(config).length > 0) query.config = config;
  if (view.flag('archived')) query.archived = true;
  return query;
}

/** URL parameters of a filter, for links to its runs. */
export function parametersOf({ config, archived, ...rest }: RunQuery): Changes {
  const pairs = Object.entries(config ?? {}).map(([key, value]) => [CONFIG_PREFIX + key, value]);
  return { ...rest, archived: archived ?? false, ...Object.fromEntries(pairs) };
}

export function queryOf(view: View): RunQuery {
  return { ...filterOf(view), sort: view.text('sort', NEWEST_FIRST) };
}

/** The order after a column's heading was pressed: best first, then the other way, then the newest first. */
export function nextSort(current: string, key: string, descendingFirst: boolean): string {
  const [first, second] = descendingFirst ? [`-${key}`, key] : [key, `-${key}`];
  if (current === first) return second;
  return current === second && key !== 'created_at' ? NEWEST_FIRST : first;
}
