import fc from 'fast-check';
import { expect, test } from 'vitest';
import type { ConfigSchema } from '../api/types';
import { draftOf, fieldsOf, read } from './draft';
import { fieldOf, parseValue, presetOf, sectionsOf } from './form';
import { parseValues, runsOf } from './sweep';

const TASK = {
  action_names: [],
  action_dims: [],
  frames_stacked: 1,
  control_period_s: 0.145,
  preset: {},
};
const SCHEMA: ConfigSchema = {
  schema: {
    properties: {
      task: { type: 'string', default: 'pointing' },
      algorithm: { enum: ['bpn', 'bqn'], default: 'bpn' },
      seed: { type: 'integer', minimum: 0, exclusiveMaximum: 2 ** 63, default: 0 },
      hidden_units: { type: 'integer', minimum: 1, maximum: 1024, default: 100, description: 'N' },
      alpha: { type: 'number', minimum: 0, maximum: 1, default: 0.95 },
      beta: { type: 'number', exclusiveMinimum: 0, maximum: 10_000, default: 1 },
      bootstrap_terminals: { type: 'boolean', default: true },
      env_kwargs: { type: 'string', default: '' },
      crop: { type: 'string', default: '' },
      difference: { type: 'boolean', default: false },
      stop_when: { type: 'string', default: '' },
      invented_later: { type: 'integer', default: 1 },
    },
  },
  presets: {
    pointing: { hidden_units: 256 },
    sorting: { beta: 3 },
    'world:': { beta: 2, hidden_units: 50 },
  },
  tasks: [
    { name: 'pointing', title: 'Pointing', ...TASK },
    { name: 'sorting', title: 'Sorting', ...TASK },
  ],
  families: [
    {
      name: 'world',
      title: 'Worlds',
      which: '[MODULE:]ID',
      noun: 'World',
      about: '',
      pattern: String.raw`([A-Za-z_]\w*(\.[A-Za-z_]\w*)*:)?([A-Za-z0-9_.-]+/)?[A-Za-z0-9_.-]+`,
      examples: ['Flat-v1'],
    },
  ],
  family_options: ['env_kwargs', 'crop', 'difference'],
  algorithms: [
    { name: 'bpn', preset: {} },
    { name: 'bqn', preset: { beta: 7, bootstrap_terminals: false } },
  ],
  defaults: {},
};
const field = (key: string) => fieldOf(SCHEMA.schema.properties, key);

test('every key of the schema has its field, also one that nobody placed', () => {
  const keys = sectionsOf(SCHEMA, 'world:A-v0').flatMap((section) =>
    section.fields.map((one) => one.key),
  );
  expect([...keys].sort()).toEqual(
    Object.keys(SCHEMA.schema.properties)
      .filter((key) => key !== 'task' && key !== 'algorithm')
      .sort(),
  );
});

test.each([
  ['hidden_units', '1,024', 'must be a number'],
  ['hidden_units', '3.5', 'must be a whole number'],
  ['hidden_units', '1025', 'must be from 1 to 1,024'],
  ['alpha', '', 'must be a number'],
  ['alpha', '1.01', 'must be from 0 to 1'],
  ['beta', '0', 'must be above 0, at most 10,000'],
  ['seed', '-1', 'must be at least 0'],
  ['bootstrap_terminals', 'yes', 'must be true or false'],
  ['algorithm', 'dqn', 'must be one of bpn, bqn'],
])('%s = %s %s', (key, text, wrong) => expect(parseValue(field(key), text)).toEqual({ wrong }));

test('a text may be taken out where none is the default', () => {
  expect(parseValue(field('stop_when'), ' ')).toEqual({ value: '' });
  expect(parseValue(field('task'), ' ')).toEqual({ wrong: 'must not be empty' });
});

test('what a number prints as is read back', () => {
  fc.assert(
    fc.property(fc.double({ min: 0, max: 1, noNaN: true }), (value) => {
      expect(parseValue(field('alpha'), String(value))).toEqual({ value: value === 0 ? 0 : value });
    }),
  );
});

test('a task has its preset over the defaults', () => {
  expect(presetOf(SCHEMA, 'pointing')).toMatchObject({
    hidden_units: 256,
    beta: 1,
    task: 'pointing',
  });
  expect(presetOf(SCHEMA, 'sorting')).toMatchObject({ hidden_units: 100, beta: 3 });
});

test('an algorithm begins with its own values, and with another only where somebody says so', () => {
  expect(presetOf(SCHEMA, 'sorting', 'bqn')).toMatchObject({ beta: 7, bootstrap_terminals: false });
  expect(presetOf(SCHEMA, 'sorting', 'bpn')).toMatchObject({ beta: 3, bootstrap_terminals: true });
  const config = { task: 'sorting', algorithm: 'bqn', beta: 3, bootstrap_terminals: false };
  const draft = draftOf(SCHEMA, config);
  expect(read(SCHEMA, draft).config).toEqual({ task: 'sorting', algorithm: 'bqn', beta: 3 });
  draft.texts = { beta: '7' };
  expect(read(SCHEMA, draft).config).toEqual({ task: 'sorting', algorithm: 'bqn' });
  draft.sweep = true;
  draft.axes = [{ key: 'algorithm', text: 'bpn bqn' }];
  expect(read(SCHEMA, draft).config).toEqual({ task: 'sorting', beta: 7 });
});

test('one of a family has the preset of its kind, and needs a name', () => {
  expect(presetOf(SCHEMA, 'world:Some-v0')).toMatchObject({
    hidden_units: 50,
    beta: 2,
    task: 'world:Some-v0',
  });
  const draft = draftOf(SCHEMA, { task: 'world:space/Some-v0', hidden_units: 60 });
  expect(read(SCHEMA, draft)).toMatchObject({
    config: { task: 'world:space/Some-v0', hidden_units: 60 },
    wrong: {},
  });
  for (const task of ['world:minigrid:Empty-5x5-v0', 'world:some.pack:space/Some-v0']) {
    expect(read(SCHEMA, { ...draft, task }).wrong).toEqual({});
  }
  for (const task of [
    'world:',
    'world:a b',
    'world:a/b/c',
    'world:a-b:C-v0',
    'world:a..b:C',
    'world::C',
  ]) {
    expect(read(SCHEMA, { ...draft, task }).wrong.task).toBe(
      'must be [MODULE:]ID, such as Flat-v1',
    );
  }
});

test('only what differs from the preset is asked for', () => {
  const draft = draftOf(SCHEMA, {
    task: 'pointing',
    hidden_units: 256,
    alpha: 0.8,
    algorithm: 'bqn',
  });
  expect(read(SCHEMA, draft)).toMatchObject({
    config: { task: 'pointing', alpha: 0.8, algorithm: 'bqn' },
    runs: 1,
    wrong: {},
  });
  draft.task = 'sorting';
  draft.texts = { beta: '3', hidden_units: 'many' };
  expect(read(SCHEMA, draft)).toMatchObject({
    config: { task: 'sorting', algorithm: 'bqn' },
    wrong: { hidden_units: 'must be a number' },
  });
});

test('a sweep is its grid times its seeds, and says where it is wrong', () => {
  const draft = draftOf(SCHEMA, { task: 'pointing', alpha: 0.5 });
  draft.sweep = true;
  draft.axes = [
    { key: 'alpha', text: '0.5, 0.9 0.95' },
    { key: 'algorithm', text: 'bpn bqn' },
  ];
  draft.seeds = '0-3, 10';
  expect(read(SCHEMA, draft)).toEqual({
    config: { task: 'pointing' },
    grid: { alpha: [0.5, 0.9, 0.95], algorithm: ['bpn', 'bqn'] },
    seeds: [0, 1, 2, 3, 10],
    runs: 30,
    wrong: {},
  });
  draft.axes = [{ key: 'hidden_units', text: '100 100' }];
  draft.seeds = '5-2';
  expect(read(SCHEMA, draft).wrong).toEqual({
    'grid.hidden_units': '100 stands twice',
    seeds: '5-2: must rise, and by less than 1000',
  });
  draft.axes = [{ key: 'hidden_units', text: '1-900' }];
  draft.seeds = '0-1';
  expect(read(SCHEMA, draft).wrong.seeds).toContain('1800 runs');
});

test('what only families leave open is asked of their tasks alone, and may be emptied again', () => {
  const draft = draftOf(SCHEMA, { task: 'world:A-v0', crop: '0,34,160,160', difference: true });
  expect(read(SCHEMA, draft).config).toEqual({
    task: 'world:A-v0',
    crop: '0,34,160,160',
    difference: true,
  });
  expect(read(SCHEMA, { ...draft, task: 'pointing' }).config).toEqual({ task: 'pointing' });
  draft.texts.crop = ' ';
  expect(read(SCHEMA, draft)).toMatchObject({ wrong: {} });
  expect(read(SCHEMA, draft).config).not.toHaveProperty('crop');
  const [first] = sectionsOf(SCHEMA, 'world:A-v0');
  expect(first?.fields.map((one) => one.key)).toEqual(['env_kwargs', 'crop', 'difference']);
  const others = sectionsOf(SCHEMA, 'pointing').flatMap((section) => section.fields);
  expect(others.map((one) => one.key)).not.toContain('crop');
});

test('texts are separated by semicolons, since they have commas in them', () => {
  expect(parseValues(field('crop'), '0,0,9,9; 0,34,160,160 ')).toEqual({
    values: ['0,0,9,9', '0,34,160,160'],
  });
  expect(parseValues(field('env_kwargs'), '{"a": 1, "b": 2}')).toEqual({
    values: ['{"a": 1, "b": 2}'],
  });
});

test('lists of values', () => {
  expect(parseValues(field('hidden_units'), '50..52')).toEqual({ values: [50, 51, 52] });
  expect(parseValues(field('alpha'), ' ,0.5,')).toEqual({ values: [0.5] });
  expect(parseValues(field('alpha'), '')).toEqual({ wrong: 'needs at least one value' });
  expect(parseValues(field('alpha'), '0-1')).toEqual({ wrong: '0-1 must be a number' });
  expect(runsOf([3, 4], 0)).toBe(12);
  expect(fieldsOf(SCHEMA).map((one) => one.key)).not.toContain('task');
});
