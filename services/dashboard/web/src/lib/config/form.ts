/** A form of a run's configuration, made from its JSON schema: fields, limits, and values out of text. */

import type {
  Config,
  ConfigSchema,
  ConfigValue,
  JsonSchemaProperty,
  TaskFamily,
} from '../api/types';
import { number } from '../format';

export interface Field {
  key: string;
  about: string;
  kind: 'integer' | 'number' | 'boolean' | 'choice' | 'text';
  choices: string[];
  limits: string; // in words, for the hint
  schema: JsonSchemaProperty;
}

export interface Section {
  title: string;
  open: boolean;
  fields: Field[];
}

/* What belongs together; keys that are not named here come last, so that a new one is never missing. */
const SECTIONS: { title: string; open: boolean; keys: string[] }[] = [
  {
    title: 'Run',
    open: true,
    keys: ['seed', 'iterations', 'hidden_units', 'alpha', 'beta', 'robots', 'init_from'],
  },
  {
    title: 'Data of an iteration',
    open: false,
    keys: [
      'episodes',
      'steps',
      'replay_iterations',
      'replay_transitions',
      'reward_scale',
      'disturb',
      'augment',
    ],
  },
  {
    title: 'Policy update',
    open: false,
    keys: [
      'epochs',
      'max_updates',
      'batch_size',
      'beta_run_final_factor',
      'gamma',
      'n_step',
      'gap_floor',
      'bootstrap_terminals',
      'learning_rate',
      'lr_update_final_factor',
      'lr_run_final_factor',
      'scale_initial',
      'algorithm_options',
      'conv',
    ],
  },
  {
    title: 'Evaluation, early end, callbacks',
    open: false,
    keys: ['evaluate_every', 'evaluate_episodes', 'stop_when', 'callbacks', 'tensorboard'],
  },
  { title: 'Exploration of BQN and DQN', open: false, keys: ['epsilon_initial', 'epsilon_final'] },
];
const ELSEWHERE = new Set(['task', 'algorithm']);

/** The form for a task: every value that means something for it. */
export function sectionsOf(all: ConfigSchema, task: string): Section[] {
  const { schema } = all;
  const rest = new Set(
    Object.keys(schema.properties).filter((key) => !ELSEWHERE.has(key) && concerns(all, key, task)),
  );
  const first = { title: familyOf(all, task)?.noun ?? '', open: false, keys: all.family_options };
  const sections = [first, ...SECTIONS].map(({ title, open, keys }) => ({
    title,
    open,
    fields: keys.filter((key) => rest.delete(key)).map((key) => fieldOf(schema.properties, key)),
  }));
  const others = [...rest].map((key) => fieldOf(schema.properties, key));
  const last = { title: 'Where and how it runs', open: false, fields: others };
  return [...sections, last].filter(({ fields }) => fields.length > 0);
}

export function fieldOf(properties: Record<string, JsonSchemaProperty>, key: string): Field {
  const schema = properties[key] ?? {};
  const kind = schema.enum
    ? 'choice'
    : schema.type === 'integer' || schema.type === 'number' || schema.type === 'boolean'
      ? schema.type
      : 'text';
  return {
    key,
    about: schema.description ?? '',
    kind,
    choices: schema.enum?.map(String) ?? [],
    limits: limitsOf(schema),
    schema,
  };
}

/** What the names of a family's tasks begin with; also the preset of those without their own. */
export function prefixOf(family: TaskFamily): string {
  return `${family.name}:`;
}

/** The family that a task is of; undefined: it is one task. */
export function familyOf({ families }: ConfigSchema, task: string): TaskFamily | undefined {
  return families.find((family) => task.startsWith(prefixOf(family)));
}

/** What is wrong with a task's name; empty: nothing. */
export function wrongTask(schema: ConfigSchema, task: string): string {
  const family = familyOf(schema, task);
  if (!family) return '';
  const which = task.slice(prefixOf(family).length);
  if (new RegExp(`^(?:${family.pattern})$`).test(which)) return '';
  const [example] = family.examples;
  return `must be ${family.which}${example ? `, such as ${example}` : ''}`;
}

/** Whether the value means something for the task. */
export function concerns(schema: ConfigSchema, key: string, task: string): boolean {
  return !schema.family_options.includes(key) || familyOf(schema, task) !== undefined;
}

/** What a task's runs have unless something is changed; what an algorithm begins with has precedence. */
export function presetOf(schema: ConfigSchema, task: string, algorithm?: string): Config {
  const defaults = Object.fromEntries(
    Object.entries(schema.schema.properties).map(([key, property]) => [
      key,
      property.default ?? null,
    ]),
  );
  const family = familyOf(schema, task);
  const preset = schema.presets[task] ?? (family ? schema.presets[prefixOf(family)] : {});
  const ofTask: Config = { ...defaults, ...schema.defaults, ...preset, task };
  const chosen = algorithm ?? ofTask.algorithm;
  const ofAlgorithm = schema.algorithms.find(({ name }) => name === chosen)?.preset;
  return { ...ofTask, ...ofAlgorithm };
}

/** A value out of what somebody typed, or what is wrong with it. */
export function parseValue(field: Field, text: string): { value: ConfigValue } | { wrong: string } {
  const trimmed = text.trim();
  if (field.kind === 'boolean') {
    if (!['true', 'false'].includes(trimmed)) return { wrong: 'must be true or false' };
    return { value: trimmed === 'true' };
  }
  if (field.kind === 'choice') {
    if (!field.choices.includes(trimmed))
      return { wrong: `must be one of ${field.choices.join(', ')}` };
    return { value: trimmed };
  }
  if (field.kind === 'text') {
    const mayBeEmpty = field.schema.default === '';
    return trimmed || mayBeEmpty ? { value: trimmed } : { wrong: 'must not be empty' };
  }
  const value = trimmed === '' ? NaN : Number(trimmed);
  if (!Number.isFinite(value)) return { wrong: 'must be a number' };
  if (field.kind === 'integer' && !Number.isSafeInteger(value))
    return { wrong: 'must be a whole number' };
  return withinLimits(field.schema, value)
    ? { value }
    : { wrong: `must be ${/^\d/.test(field.limits) ? 'from ' : ''}${field.limits}` };
}

export function textOf(value: ConfigValue | undefined): string {
  return value === null || value === undefined ? '' : String(value);
}

function withinLimits(schema: JsonSchemaProperty, value: number): boolean {
  return (
    value >= (schema.minimum ?? -Infinity) &&
    value <= (schema.maximum ?? Infinity) &&
    value > (schema.exclusiveMinimum ?? -Infinity) &&
    value < (schema.exclusiveMaximum ?? Infinity)
  );
}

const BEYOND_NEED = 1e15; // a limit that nobody meets is no help

function limitsOf(schema: JsonSchemaProperty): string {
  const { minimum, maximum, exclusiveMinimum, exclusiveMaximum } = schema;
  const text = (value: number): string => number(value, 6);
  if (minimum !== undefined && maximum !== undefined) return `${text(minimum)} to ${text(maximum)}`;
  const limits = [
    minimum !== undefined ? `at least ${text(minimum)}` : '',
    exclusiveMinimum !== undefined ? `above ${text(exclusiveMinimum)}` : '',
    maximum !== undefined ? `at most ${text(maximum)}` : '',
    exclusiveMaximum !== undefined && exclusiveMaximum < BEYOND_NEED
      ? `below ${text(exclusiveMaximum)}`
      : '',
  ];
  return limits.filter(Boolean).join(', ');
}
