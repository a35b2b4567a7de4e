/** What somebody is about to start: texts of a form on one side, a request on the other. */

import type { Config, ConfigSchema, ConfigValue } from '../api/types';
import {
  concerns,
  familyOf,
  fieldOf,
  parseValue,
  presetOf,
  textOf,
  wrongTask,
  type Field,
} from './form';
import type { StartRequest } from '../start';
import { MOST_RUNS, parseValues, runsOf, type Axis } from './sweep';

export interface Draft {
  task: string;
  algorithm: string;
  /** What was typed, by key; keys that are not in it have the preset's value. */
  texts: Record<string, string>;
  sweep: boolean;
  axes: Axis[];
  seeds: string;
}

export interface Reading {
  /** The task and what differs from its preset. */
  config: Config;
  grid: Record<string, ConfigValue[]>;
  seeds: number[];
  runs: number;
  /** What is wrong, by key; `grid.alpha` and `seeds` are fields of the sweep. */
  wrong: Record<string, string>;
}

export function fieldsOf(schema: ConfigSchema): Field[] {
  const { properties } = schema.schema;
  return Object.keys(properties)
    .filter((key) => key !== 'task')
    .map((key) => fieldOf(properties, key));
}

/** A draft for another run like this one. */
export function draftOf(schema: ConfigSchema, config: Config): Draft {
  const task = textOf(config.task) || schema.tasks[0]?.name || '';
  const preset = presetOf(
    schema,
    task,
    config.algorithm === undefined ? undefined : textOf(config.algorithm),
  );
  const texts = Object.entries(config)
    .filter(([key, value]) => !['task', 'algorithm'].includes(key) && preset[key] !== value)
    .map(([key, value]) => [key, textOf(value)]);
  return {
    task,
    algorithm: textOf(config.algorithm ?? preset.algorithm),
    texts: Object.fromEntries(texts),
    sweep: false,
    axes: [],
    seeds: '0-4',
  };
}

/** A draft as somebody asked for it to begin. */
export function beginning(schema: ConfigSchema, request: StartRequest): Draft {
  const draft = draftOf(schema, request.from ?? {});
  return {
    ...draft,
    sweep: request.sweep ?? false,
    axes: request.axes ?? [],
    seeds: request.seeds ?? draft.seeds,
  };
}

/** The configuration of a sweep's first run, or of the one run. */
export function firstOf({ config, grid, seeds }: Reading): Config {
  const point = Object.entries(grid).flatMap(([key, [value]]) =>
    value === undefined ? [] : [[key, value] as const],
  );
  const [seed] = seeds;
  return { ...config, ...Object.fromEntries(point), ...(seed === undefined ? {} : { seed }) };
}

/** Whether a robot worker would have to open its environment first: nothing to ask for at every key. */
export function isUnseen(schema: ConfigSchema, config: Config): boolean {
  return familyOf(schema, textOf(config.task)) !== null && !config.actions;
}

/** Reads a draft: a request as far as it is right, and what is wrong. */
export function read(schema: ConfigSchema, draft: Draft): Reading {
  const preset = presetOf(schema, draft.task, draft.algorithm);
  const fields = fieldsOf(schema);
  const byKey = new Map(fields.map((field) => [field.key, field]));
  const reading: Reading = {
    config: { task: draft.task },
    grid: {},
    seeds: [],
    runs: 1,
    wrong: {},
  };
  const wrong = wrongTask(schema, draft.task);
  if (wrong) reading.wrong.task = wrong;
  const swept = new Set(draft.sweep ? ['seed', ...draft.axes.map((axis) => axis.key)] : []);
  const texts = { ...draft.texts, algorithm: draft.algorithm };
  for (const [key, text] of Object.entries(texts)) {
    const field = byKey.get(key);
    if (!field || swept.has(key) || !concerns(schema, key, draft.task)) continue;
    const parsed = parseValue(field, text);
    if ('wrong' in parsed) reading.wrong[key] = parsed.wrong;
    // where several algorithms are tried, each has its own preset
    else if (swept.has('algorithm') || parsed.value !== preset[key])
      reading.config[key] = parsed.value;
  }
  if (draft.sweep) readSweep(draft, byKey, reading);
  return reading;
}

function readSweep(draft: Draft, fields: Map<string, Field>, reading: Reading): void {
  for (const { key, text } of draft.axes) {
    const field = fields.get(key);
    const parsed = field ? parseValues(field, text) : { wrong: 'is unknown' };
    if ('wrong' in parsed) reading.wrong[`grid.${key}`] = parsed.wrong;
    else reading.grid[key] = parsed.values;
  }
  const seedField = fields.get('seed');
  const parsed = seedField ? parseValues(seedField, draft.seeds) : { wrong: 'is unknown' };
  if ('wrong' in parsed) reading.wrong.seeds = parsed.wrong;
  else reading.seeds = parsed.values.map(Number);
  reading.runs = runsOf(
    Object.values(reading.grid).map((values) => values.length),
    reading.seeds.length,
  );
  if (reading.runs > MOST_RUNS) {
    reading.wrong.seeds = `${reading.runs} runs are more than the ${MOST_RUNS} that a sweep may have`;
  }
}
