/** What the REST interface carries. Times are Unix seconds, pixels are pixels of the 84 x 84 frame. */

export type RunState =
  'queued' | 'running' | 'stopping' | 'finished' | 'failed' | 'stopped' | 'lost';

export type Role = 'viewer' | 'operator' | 'admin';
export type ConfigValue = string | number | boolean | null;
export type Config = Record<string, ConfigValue>;

export interface Session {
  name: string;
  role: Role;
}

export interface Run {
  id: string;
  name: string;
  state: RunState;
  desired_state: 'running' | 'stopped';
  task: string;
  algorithm: string;
  seed: number;
  config: Config;
  config_hash: string;
  attempt: number;
  iteration: number;
  iterations: number;
  weights_version: number | null;
  summary: {
    return_px: { last: number | null; best: number | null; mean_last_5: number | null };
    length: { last: number | null };
  };
  error: string;
  notes: string;
  tags: string[];
  sweep_id: string | null;
  archived_at_unix_s: number | null;
  created_at_unix_s: number;
  updated_at_unix_s: number;
  rev: number;
}

export interface Page<Item> {
  items: Item[];
  next_cursor: string | null;
  total: number;
}

export type SweepPage = Omit<Page<Sweep>, 'total'>;

/** Filters, order and page of a list of runs; keys of `config` are configuration keys. */
export interface RunQuery {
  search?: string;
  state?: string;
  task?: string;
  algorithm?: string;
  sweep_id?: string;
  archived?: boolean;
  sort?: string;
  config?: Record<string, string>;
  limit?: number;
  cursor?: string;
}

export type BulkAction = 'stop' | 'resume' | 'archive' | 'unarchive';

export interface BulkResult {
  id: string;
  ok: boolean;
  problem?: { title: string; detail?: string } | null;
}

export interface Sweep {
  id: string;
  name: string;
  config: Config;
  grid: Record<string, ConfigValue[]>;
  seeds: number[];
  run_ids: string[];
  states: Partial<Record<RunState, number>>;
  created_at_unix_s: number;
}

export interface JsonSchemaProperty {
  type?: 'string' | 'integer' | 'number' | 'boolean';
  enum?: ConfigValue[];
  const?: ConfigValue;
  default?: ConfigValue;
  description?: string;
  title?: string;
  minimum?: number;
  maximum?: number;
  exclusiveMinimum?: number;
  exclusiveMaximum?: number;
}

export interface ConfigSchema {
  schema: { properties: Record<string, JsonSchemaProperty> };
  presets: Record<string, Config>;
  tasks: { name: string; title: string }[];
  defaults: Config;
}

export interface ConfigDiff {
  same: number;
  differences: { key: string; this: ConfigValue; other: ConfigValue }[];
}

export type HeatmapValue = 'best_mean' | 'last_mean';

export interface Heatmap {
  x: { key: string; values: ConfigValue[] };
  y: { key: string; values: ConfigValue[] };
  cells: HeatmapCell[];
}

export interface HeatmapCell {
  x: ConfigValue;
  y: ConfigValue;
  n: number;
  mean: number | null;
  std: number | null;
  run_ids: string[];
}

export type XAxis = 'iteration' | 'wall_s' | 'transitions';
export type Statistic = 'mean' | 'median' | 'iqm';
export type Band = 'std' | 'sem' | 'ci95' | 'minmax';

export interface SeriesQuery {
  runs?: string[];
  filter?: Record<string, string | boolean>;
  group_by: string[] | 'all_but_seed' | null;
  metrics: string[];
  x: XAxis;
  range: [number, number] | null;
  max_points: number;
  statistic: Statistic;
  band: Band;
}

export type Column = (number | null)[];

/** One line of a chart: a run, or a group of runs with its band. `n` is how many runs stand behind a point. */
export interface Series {
  metric: string;
  /** The same for the same group whatever else is shown. */
  key: string;
  label: string;
  group: Record<string, ConfigValue>;
  run_ids: string[];
  n_points: number;
  /** Width of a bucket in x; 0: points as they are. */
  bucket: number;
  x: Column;
  n: Column;
  value: Column;
  low: Column;
  high: Column;
  min: Column;
  max: Column;
  last: Column;
}

export interface SeriesAnswer {
  series: Series[];
  seq: number;
}

export interface MetricName {
  name: string;
  n: number;
}
