/** Columns of runs by name, as the server knows them: `config.KEY`, `metric.NAME.VALUE`, or a run's own. */

import type { MetricValue } from '../api/types';
import { metricNamed } from '../metrics';

export const METRIC_VALUES: readonly [MetricValue, ...MetricValue[]] = [
  'mean_5',
  'last',
  'highest',
  'lowest',
  'mean_20',
  'mean_100',
];
export const VALUE_TITLES: Record<MetricValue, string> = {
  mean_5: 'mean of last 5',
  last: 'newest',
  highest: 'highest',
  lowest: 'lowest',
  mean_20: 'mean of last 20',
  mean_100: 'mean of last 100',
};
export const CONFIG = 'config.';
export const METRIC = 'metric.';

export interface MetricColumn {
  metric: string;
  value: MetricValue;
}

export function metricColumn(metric: string, value: MetricValue): string {
  return `${METRIC}${metric}.${value}`;
}

/** Metric and value of a column; null if it is none of a metric. */
export function readMetricColumn(name: string): MetricColumn | null {
  if (!name.startsWith(METRIC)) return null;
  const dot = name.lastIndexOf('.');
  const value = METRIC_VALUES.find((one) => one === name.slice(dot + 1));
  const metric = name.slice(METRIC.length, dot);
  return value && metric ? { metric, value } : null;
}

/** What a column is called. */
export function columnTitle(name: string): string {
  const found = readMetricColumn(name);
  if (found) return `${metricNamed(found.metric).title}, ${VALUE_TITLES[found.value]}`;
  return name.startsWith(CONFIG) ? name.slice(CONFIG.length) : name;
}

/** The unit of a column's numbers. */
export function columnUnit(name: string): string {
  const found = readMetricColumn(name);
  return found ? metricNamed(found.metric).unit : '';
}

/** Metrics of which less is better. */
const LOWER =
  /(^|[._])(loss|loss_first|saturation|deadline_misses|weights_version_lag|failures)($|\.)|_s$|error/;

export function higherIsBetter(metric: string): boolean {
  return !LOWER.test(metric);
}
