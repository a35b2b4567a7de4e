/** What the metrics are called, their units, and which of them a run's page opens with (docs/metrics.md). */

import type { Config } from './api/types';

export interface Metric {
  name: string;
  title: string;
  unit: string;
  about: string;
}

const KNOWN: Metric[] = [
  {
    name: 'return_px',
    title: 'Return',
    unit: 'px',
    about: 'mean over episodes of the sum of rewards, exploration included',
  },
  {
    name: 'return',
    title: 'Return',
    unit: '',
    about: 'mean over episodes of the sum of rewards, in the environment’s own unit',
  },
  {
    name: 'eval_return',
    title: 'Return, evaluated',
    unit: '',
    about: 'mean over greedy episodes that nothing is learned from, in the return’s unit',
  },
  {
    name: 'eval_success',
    title: 'Success, evaluated',
    unit: 'share',
    about: 'of those greedy episodes, as the task or its environment defines it',
  },
  { name: 'eval_s', title: 'Evaluation time', unit: 's', about: 'beside the iteration’s time' },
  {
    name: 'length',
    title: 'Episode length',
    unit: 'steps',
    about: 'mean; shorter when episodes fail',
  },
  {
    name: 'loss',
    title: 'Loss',
    unit: '',
    about: 'mean of half the squared error over the last epoch of the update',
  },
  {
    name: 'loss_first',
    title: 'Loss, first epoch',
    unit: '',
    about: 'mean of half the squared error over the first epoch of the update',
  },
  {
    name: 'scale',
    title: 'Scale λ',
    unit: '',
    about: 'factor from integer outputs to action preferences',
  },
  {
    name: 'max_preference',
    title: 'max |P|',
    unit: 'scaled reward',
    about: 'largest action preference over the data',
  },
  {
    name: 'max_target',
    title: 'max |y|',
    unit: 'scaled reward',
    about: 'largest target over the data',
  },
  {
    name: 'entropy',
    title: 'Entropy',
    unit: 'nats',
    about: 'how undecided the policy is over the data, before the update',
  },
  {
    name: 'agreement',
    title: 'Agreement',
    unit: 'share',
    about: 'of the newest data, where the best action is the same after the update',
  },
  {
    name: 'saturation',
    title: 'Saturation',
    unit: 'share',
    about: 'targets beyond what the network can express; should stay near 0',
  },
  {
    name: 'epsilon',
    title: 'Random actions ε',
    unit: 'share',
    about: 'share of uniformly random actions (BQN)',
  },
  {
    name: 'terminated',
    title: 'Terminated',
    unit: 'episodes',
    about: 'ended by the task, good or bad, not by time',
  },
  {
    name: 'successes',
    title: 'Successes',
    unit: 'episodes',
    about: 'as the task or its environment defines it',
  },
  {
    name: 'failures',
    title: 'Terminated (older runs)',
    unit: 'episodes',
    about: 'ended by the task, good or bad; what runs of older versions call it',
  },
  {
    name: 'deadline_misses',
    title: 'Deadline misses',
    unit: 'steps',
    about: 'control periods without an action in time',
  },
  { name: 'episodes', title: 'Episodes', unit: 'episodes', about: 'new in the iteration' },
  { name: 'transitions', title: 'Transitions', unit: 'steps', about: 'new in the iteration' },
  {
    name: 'updates',
    title: 'Optimizer steps',
    unit: '',
    about: 'of the iteration’s policy update',
  },
  {
    name: 'update_s',
    title: 'Update time',
    unit: 's',
    about: 'seconds that the policy update took',
  },
  {
    name: 'collect_s',
    title: 'Collection time',
    unit: 's',
    about: 'from the hand-out of the first episode to the last on disk',
  },
  { name: 'iteration_s', title: 'Iteration time', unit: 's', about: 'the whole iteration' },
  {
    name: 'weights_version_lag',
    title: 'Weights version lag',
    unit: 'versions',
    about: 'how far edges were behind their learner when it handed them episodes, on average',
  },
  {
    name: 'attempt',
    title: 'Attempt',
    unit: '',
    about: 'how often a learner has begun or resumed the run',
  },
  { name: 'weights_version', title: 'Weights version', unit: '', about: 'policy updates done' },
];

/** Those that are known by name: others are read from the runs. */
export const METRIC_NAMES: readonly string[] = KNOWN.map((metric) => metric.name);

const BY_NAME = new Map(KNOWN.map((metric) => [metric.name, metric]));

const AFTER_RETURN = [
  'length',
  'loss',
  'scale',
  'max_preference',
  'saturation',
  'entropy',
  'agreement',
  'weights_version_lag',
];

/** What the returns of runs are called together, each of which has this return metric: no unit where they differ. */
export function returnOf(...returns: string[]): Metric {
  return metricNamed(returns.find((name) => name !== 'return_px') ?? 'return_px');
}

/** What a page of runs opens with that have these return metrics. */
export function principalOf(...metrics: string[]): string[] {
  const returns = metrics.length > 0 ? metrics : ['return_px'];
  return [...new Set(returns), ...AFTER_RETURN];
}

/** What the page of a run that is evaluated during training opens with too. */
export function evaluatedOf(metric: string, config: Config): string[] {
  if (!config.evaluate_every) return [];
  return metric === 'return_px' ? ['eval_return', 'eval_success'] : ['eval_return'];
}

/** Title and unit of a metric; of an unknown one, the unit is read off the end of its name. */
export function metricNamed(name: string): Metric {
  return BY_NAME.get(name) ?? { name, title: name, unit: unitFromName(name), about: '' };
}

function unitFromName(name: string): string {
  const unit = /_(px|s|ms|us|ns|bytes|deg|hz|percent)(\.|$)/.exec(name)?.[1];
  return { us: 'µs', hz: 'Hz', percent: '%' }[unit ?? ''] ?? unit ?? '';
}
