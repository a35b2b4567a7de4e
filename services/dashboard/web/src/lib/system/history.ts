/** What is known of services over time, as lines of charts. */

import type { components } from '../../../generated/api';
import type { Line } from '../chart/plan';
import type { StrokeBook } from '../colour';
import { nodeName } from './topology';

export type ServiceHistory = components['schemas']['ServiceHistory'];
export type Measure = 'cpu_percent' | 'rss_bytes' | 'messages_per_s' | 'dropped_per_s';

export const SPANS: Record<string, { title: string; seconds: number }> = {
  hour: { title: '1 h', seconds: 3600 },
  day: { title: '24 h', seconds: 86_400 },
  week: { title: '7 d', seconds: 604_800 },
};

/** A pause of so many usual steps in what a service told is a hole in its line. */
const HOLE = 4;

/** One line for each service that told something; x is seconds before now, so below 0. */
export function historyLines(
  services: readonly ServiceHistory[],
  measure: Measure,
  strokes: StrokeBook,
  nowUnixS: number,
): Line[] {
  const told = services.filter((one) => one[measure].some((value) => value !== null));
  const given = strokes.assign(told.map((one) => one.worker));
  const names = new Map<string, number>();
  for (const one of told) names.set(nodeName(one), (names.get(nodeName(one)) ?? 0) + 1);
  return told.map((one) => {
    const name = nodeName(one);
    const { x, value } = withHoles(one.at, one[measure]);
    return {
      key: one.worker,
      // Of several that are called alike, which is on which machine.
      label: (names.get(name) ?? 0) > 1 ? `${name}, ${one.worker.slice(-4)} on ${one.host}` : name,
      stroke: given.get(one.worker) ?? { colour: 0, dash: [] },
      x: x.map((at) => at - nowUnixS),
      value,
    };
  });
}

/** Puts a value that is none where a service told nothing for a while: it was not there, or not heard. */
export function withHoles(
  at: readonly number[],
  values: readonly (number | null)[],
): { x: number[]; value: (number | null)[] } {
  const steps = at.slice(1).map((moment, i) => moment - (at[i] ?? moment));
  const usual = [...steps].sort((a, b) => a - b)[Math.floor(steps.length / 2)] ?? 0;
  const x: number[] = [];
  const value: (number | null)[] = [];
  at.forEach((moment, i) => {
    const step = i > 0 ? (steps[i - 1] ?? 0) : 0;
    if (usual > 0 && step > HOLE * usual) {
      x.push(moment - step / 2);
      value.push(null);
    }
    x.push(moment);
    value.push(values[i] ?? null);
  });
  return { x, value };
}
