/** Columns of the table of runs: what they are called, say, and sort by. */

import type { Run } from '../api/types';
import { bytes, configValue, integer, number, quantity, shortId } from '../format';
import { columnTitle, higherIsBetter, readMetricColumn } from '../compare/columns';
import { metricNamed, returnOf } from '../metrics';

export type CellKind = 'name' | 'state' | 'progress' | 'number' | 'age' | 'tags' | 'sweep' | 'text';

export interface Column {
  key: string;
  title: string;
  kind: CellKind;
  unit?: string;
  /** What the server sorts by; absent: it cannot. */
  sort?: string;
  descendingFirst?: boolean;
  text: (run: Run) => string;
  about?: string;
}

export const COLUMNS: readonly Column[] = [
  { key: 'name', title: 'Run', kind: 'name', sort: 'name', text: nameOf },
  { key: 'state', title: 'State', kind: 'state', sort: 'state', text: (run) => run.state },
  { key: 'task', title: 'Task', kind: 'text', sort: 'task', text: (run) => run.task },
  {
    key: 'algorithm',
    title: 'Algorithm',
    kind: 'text',
    sort: 'algorithm',
    text: (run) => run.algorithm,
  },
  { key: 'seed', title: 'Seed', kind: 'number', sort: 'seed', text: (run) => integer(run.seed) },
  {
    key: 'iteration',
    title: 'Iteration',
    kind: 'progress',
    sort: 'iteration',
    descendingFirst: true,
    text: (run) => `${integer(run.iteration)} of ${integer(run.iterations)}`,
    about: 'policy updates done',
  },
  measure('return_last', 'Return', (run) => run.summary.returns.last, 'of the newest iteration'),
  measure('return_best', 'Best return', (run) => run.summary.returns.best, 'of any iteration'),
  measure(
    'return_mean_last_5',
    'Return, last 5',
    (run) => run.summary.returns.mean_last_5,
    'mean of the last five iterations',
  ),
  {
    key: 'length',
    title: 'Length',
    kind: 'number',
    unit: 'steps',
    text: (run) => number(run.summary.length.last),
    about: 'mean episode length of the newest iteration',
  },
  {
    key: 'created',
    title: 'Created',
    kind: 'age',
    sort: 'created_at',
    descendingFirst: true,
    text: () => '',
  },
  {
    key: 'updated',
    title: 'Changed',
    kind: 'age',
    sort: 'updated_at',
    descendingFirst: true,
    text: () => '',
  },
  { key: 'tags', title: 'Tags', kind: 'tags', text: (run) => run.tags.join(', ') },
  {
    key: 'sweep',
    title: 'Sweep',
    kind: 'sweep',
    text: (run) => (run.sweep_id ? shortId(run.sweep_id) : ''),
  },
  { key: 'notes', title: 'Notes', kind: 'text', text: (run) => run.notes },
  {
    key: 'weights_version',
    title: 'Weights',
    kind: 'number',
    text: (run) => integer(run.weights_version),
    about: 'newest version',
  },
  {
    key: 'attempt',
    title: 'Attempt',
    kind: 'number',
    text: (run) => integer(run.attempt),
    about: 'learners that have owned the run',
  },
  {
    key: 'disk',
    title: 'On disk',
    kind: 'number',
    sort: 'disk_bytes',
    descendingFirst: true,
    text: (run) => bytes(run.disk_bytes),
    about: 'of its folder: episodes, weights, checkpoint, logs',
  },
  {
    key: 'error',
    title: 'Why it failed',
    kind: 'text',
    sort: 'error',
    descendingFirst: true,
    text: (run) => run.error.trim().split('\n')[0] ?? '',
  },
  {
    key: 'priority',
    title: 'Priority',
    kind: 'number',
    sort: 'priority',
    descendingFirst: true,
    text: (run) => integer(run.priority),
    about: 'of those that wait the highest is served first',
  },
  { key: 'id', title: 'Id', kind: 'text', text: (run) => run.id },
];

export const DEFAULT_COLUMNS = [
  'name',
  'state',
  'task',
  'algorithm',
  'seed',
  'iteration',
  'return_last',
  'return_best',
  'updated',
  'created',
];

const BY_KEY = new Map(COLUMNS.map((column) => [column.key, column]));

/** A column by key; `config.alpha` is one for every configuration key. */
export function columnOf(key: string): Column | null {
  const known = BY_KEY.get(key);
  if (known) return known;
  const metric = readMetricColumn(key);
  if (metric) {
    const { unit, about } = metricNamed(metric.metric);
    return {
      key,
      title: columnTitle(key),
      kind: 'number',
      sort: key,
      descendingFirst: higherIsBetter(metric.metric),
      text: (run) => quantity(run.values?.[key], unit),
      ...(about ? { about } : {}),
    };
  }
  if (!key.startsWith('config.')) return null;
  const name = key.slice('config.'.length);
  return {
    key,
    title: name,
    kind: 'number',
    sort: key,
    text: (run) => configValue(run.config[name]),
    about: `configuration: ${name}`,
  };
}

/** What a run is called; those without a name by task and the end of their id. */
export function nameOf(run: Pick<Run, 'id' | 'name' | 'task'>): string {
  return run.name.trim() || `${run.task} ${shortId(run.id)}`;
}

function measure(
  key: string,
  title: string,
  value: (run: Run) => number | null,
  about: string,
): Column {
  return {
    key,
    title,
    kind: 'number',
    sort: key,
    descendingFirst: true,
    text: (run) => quantity(value(run), returnOf(run.summary.returns.metric).unit),
    about,
  };
}
