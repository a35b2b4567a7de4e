/** What is about to be started: the dialog's beginning, from wherever somebody asks for it. */

import type { Config, ConfigValue, Run, Sweep } from './api/types';
import type { Axis } from './config/sweep';
import { nameOf } from './runs/columns';

export interface StartRequest {
  /** Where to start from; empty: the first task's preset. */
  from?: Config;
  /** Begin with the sweep's form. */
  sweep?: boolean;
  axes?: Axis[];
  /** Of a sweep, as they are typed: "0-4". */
  seeds?: string;
  name?: string;
  /** Where to go after a sweep was started; else to its runs. */
  then?: 'results';
}

/** Another run like this one. What it began with stays as it was named, without the digest that was found then. */
export function again(run: Run): StartRequest {
  return { from: withoutDigest(run.config), name: `${nameOf(run)}, again` };
}

/** A run that begins with the newest weights of this one. */
export function onwards(run: Run): StartRequest {
  return { from: { ...run.config, init_from: run.id }, name: `${nameOf(run)}, continued` };
}

/** The same sweep with the same grid and seeds. */
export function sweepAgain(sweep: Pick<Sweep, 'name' | 'config' | 'grid' | 'seeds'>): StartRequest {
  return {
    from: withoutDigest(sweep.config),
    sweep: true,
    axes: Object.entries(sweep.grid).map(([key, values]) => ({ key, text: listed(values) })),
    seeds: sweep.seeds.length > 0 ? sweep.seeds.join(', ') : '0',
    name: sweep.name && `${sweep.name}, again`,
  };
}

/** Every seed of one point, whether somebody was there before or not. */
export function atPoint(config: Config, point: Config, seeds: readonly number[]): StartRequest {
  return {
    from: { ...withoutDigest(config), ...point },
    sweep: true,
    axes: [],
    seeds: seeds.length > 0 ? seeds.join(', ') : '0-2',
  };
}

/* So small that a comparison is done within minutes: for looking at what there is, not for learning much. */
const SMALL: Config = { iterations: 4, episodes: 4, epochs: 2, steps: 10, hidden_units: 32 };

/** Two values of alpha with three seeds each, for whoever is here for the first time. */
export function firstComparison(task: string): StartRequest {
  return {
    from: { task, ...SMALL },
    sweep: true,
    axes: [{ key: 'alpha', text: '0.5, 0.95' }],
    seeds: '0-2',
    name: 'First comparison',
    then: 'results',
  };
}

function withoutDigest(config: Config): Config {
  const { init_from: begun } = config;
  if (typeof begun !== 'string' || begun === '') return config;
  return { ...config, init_from: begun.split(':').slice(0, 2).join(':') };
}

function listed(values: readonly ConfigValue[]): string {
  const texts = values.map(String);
  return texts.join(values.some((value) => typeof value === 'string') ? '; ' : ', ');
}
