/** Runs gathered by the values of some configuration keys. Figures are over the seeds of all runs of a group. */

import type { ConfigValue, Run, RunState } from '../api/types';
import { configValue } from '../format';
import { overSeeds, type Spread } from '../statistics';

export interface Group {
  key: string;
  values: Record<string, ConfigValue>;
  runs: Run[];
  states: Partial<Record<RunState, number>>;
  seeds: number;
  best: Spread;
  last: Spread;
}

export const ALL_BUT_SEED = 'all_but_seed';

/** Groups in the order in which they first appear. */
export function groupRuns(runs: readonly Run[], keys: readonly string[]): Group[] {
  const groups = new Map<string, Run[]>();
  for (const run of runs) {
    const key = groupKey(run, keys);
    const members = groups.get(key);
    if (members) members.push(run);
    else groups.set(key, [run]);
  }
  return [...groups].map(([key, members]) => summarize(key, keys, members));
}

/** The configuration keys in which some of the runs differ, seed left out. */
export function differingKeys(runs: readonly Run[]): string[] {
  const first = runs[0]?.config ?? {};
  const keys = new Set(runs.flatMap((run) => Object.keys(run.config)));
  return [...keys].filter(
    (key) => key !== 'seed' && runs.some((run) => run.config[key] !== first[key]),
  );
}

/** What a group is called: "alpha 0.95, hidden_units 100". */
export function groupLabel(values: Record<string, ConfigValue>): string {
  const parts = Object.entries(values).map(([key, value]) => `${key} ${configValue(value)}`);
  return parts.join(', ') || 'all runs';
}

function groupKey(run: Run, keys: readonly string[]): string {
  return JSON.stringify(keys.map((key) => run.config[key] ?? null));
}

function summarize(key: string, keys: readonly string[], runs: Run[]): Group {
  const first = runs[0];
  const values = Object.fromEntries(keys.map((name) => [name, first?.config[name] ?? null]));
  const states: Group['states'] = {};
  for (const run of runs) states[run.state] = (states[run.state] ?? 0) + 1;
  const of = (pick: (run: Run) => number | null): Spread =>
    overSeeds(
      runs.flatMap((run) => {
        const value = pick(run);
        return value === null ? [] : [{ seed: run.seed, value }];
      }),
    );
  return {
    key,
    values,
    runs,
    states,
    seeds: new Set(runs.map((run) => run.seed)).size,
    best: of((run) => run.summary.returns.best),
    last: of((run) => run.summary.returns.last),
  };
}
