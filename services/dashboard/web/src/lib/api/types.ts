/**
 * What the REST interface carries: types generated from the server's own description (`npm run types`), with
 * configurations and groups as what they hold. Times are Unix seconds, pixels are pixels of the 84 x 84 frame.
 */

import type { components } from '../../../generated/api';

type Schemas = components['schemas'];

export type ConfigValue = string | number | boolean | null;
export type Config = Record<string, ConfigValue>;

export type Session = Schemas['Session'];
export type Role = Session['role'];

export type Run = Omit<Schemas['Run'], 'config'> & { config: Config };
export type RunState = Run['state'];
export type RunPage = Omit<Schemas['RunPage'], 'items'> & { items: Run[] };
export type BulkAction = Schemas['BulkAction']['action'];
export type BulkResult = Schemas['BulkResult'];
export type RemovedRun = Schemas['RemovedRun'];
export type TidiedRun = Schemas['TidiedRun'];
export type MetricNames = Schemas['MetricNames'];
export type ConfigDiff = Schemas['ConfigDiff'];

export type Comparison = Schemas['ComparisonAnswer'];
export type ComparedGroup = Schemas['GroupShown'];
export type ComparisonQuery = Omit<
  Required<Schemas['ComparisonQuery']>,
  'filter' | 'runs' | 'group_by'
> & {
  group_by: string[] | 'all_but_seed' | null;
  runs?: string[];
  filter?: Record<string, string | boolean>;
};
/** What of a run's metric is meant: the newest value, an extreme, or the mean of so many newest. */
export type MetricValue = ComparisonQuery['value'];
export type EpisodeDistributions = Schemas['EpisodesAnswer'];
export type Overview = Omit<Schemas['Overview'], 'states' | 'differing' | 'same'> & {
  states: Partial<Record<RunState, number>>;
  differing: { key: string; distinct: number; values: { value: ConfigValue; runs: number }[] }[];
  same: Config;
};
export type FailureReason = Schemas['FailureReason'];
export type TagCount = Schemas['TagCount'];
export type SavedView = Schemas['ViewShown'];
export type Queue = Omit<Schemas['QueueShown'], 'items'> & { items: Run[] };
export type RunValues = Omit<Schemas['ValuesAnswer'], 'columns'> & {
  columns: Record<string, (string | number | boolean | null)[]>;
};

/** Filters, order and page of a list of runs; keys of `config` are configuration keys. */
export interface RunQuery {
  search?: string;
  /** In the query language: `alpha>0.5 and tag:paper`. */
  query?: string;
  state?: string;
  task?: string;
  algorithm?: string;
  sweep_id?: string;
  archived?: boolean;
  sort?: string;
  /** Columns of metrics, separated by commas: what they came to is in each run's `values`. */
  columns?: string;
  config?: Record<string, string>;
  limit?: number;
  cursor?: string;
}

export type Sweep = Omit<Schemas['Sweep'], 'config' | 'grid' | 'states'> & {
  config: Config;
  grid: Record<string, ConfigValue[]>;
  states: Partial<Record<RunState, number>>;
};
export type SweepPage = Omit<Schemas['SweepPage'], 'items'> & { items: Sweep[] };

/** One property of the configuration's JSON schema, as far as forms use it. */
export interface JsonSchemaProperty {
  type?: 'string' | 'integer' | 'number' | 'boolean';
  enum?: ConfigValue[];
  default?: ConfigValue;
  description?: string;
  minimum?: number;
  maximum?: number;
  exclusiveMinimum?: number;
  exclusiveMaximum?: number;
}

export type SystemStatus = Schemas['SystemStatus'];
export type DiskStatus = Schemas['DiskStatus'];

export type TaskInfo = Schemas['RunTask'];

export type TaskFamily = Schemas['FamilyChoice'];

export type ConfigSchema = Pick<
  Schemas['ConfigSchema'],
  'tasks' | 'families' | 'family_options'
> & {
  schema: { properties: Record<string, JsonSchemaProperty> };
  presets: Record<string, Config>;
  algorithms: { name: string; preset: Config }[];
  defaults: Config;
};

export type HeatmapCell = Omit<Schemas['HeatmapCell'], 'x' | 'y'> & {
  x: ConfigValue;
  y: ConfigValue;
};
export type Heatmap = Pick<Schemas['Heatmap'], 'metric' | 'value'> & {
  x: { key: string; values: ConfigValue[] };
  y: { key: string; values: ConfigValue[] };
  cells: HeatmapCell[];
};
export type HeatmapValue = 'best_mean' | 'last_mean';

export type Column = (number | null)[];

/** Curves to draw: of `runs`, or of all that meet `filter`. */
export type SeriesQuery = Omit<
  Required<Schemas['SeriesQuery']>,
  'runs' | 'filter' | 'group_by' | 'range'
> & {
  runs?: string[];
  filter?: Record<string, string | boolean>;
  group_by: string[] | 'all_but_seed' | null;
  range: [number, number] | null;
};
export type XAxis = SeriesQuery['x'];
export type Statistic = SeriesQuery['statistic'];
export type Band = SeriesQuery['band'];

/** One line of a chart: a run, or a group of runs with its band; `n` is how many seeds stand behind a point. */
export type Series = Omit<Schemas['SeriesShown'], 'group'> & { group: Config };
export type SeriesAnswer = Omit<Schemas['SeriesAnswer'], 'series'> & { series: Series[] };
