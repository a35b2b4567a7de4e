/** Tags: their colours, and queries for them. */

import { hash, PALETTE, type ThemeName } from '../colour';

/** A colour that belongs to the tag, whoever uses it. */
export function tagColour(tag: string, theme: ThemeName): string {
  const palette = PALETTE[theme];
  return palette[hash(tag) % (palette.length - 1)] ?? '#888888';
}

/** A value as the query language has it. */
export function quoted(value: string): string {
  return /^[^\s(),"<>=!:]+$/.test(value) ? value : `"${value.replace(/["\\]/g, '\\$&')}"`;
}

export function tagQuery(tag: string): string {
  return `tag:${quoted(tag)}`;
}

/** A query with one more condition, or without it if it ends with it. */
export function toggledCondition(query: string, condition: string): string {
  const parts = query === '' ? [] : [query];
  if (query === condition) return '';
  if (query.endsWith(` and ${condition}`)) return query.slice(0, -` and ${condition}`.length);
  const needs = parts.some((part) => /(^|\s)or(\s|$)/i.test(part));
  return [...parts.map((part) => (needs ? `(${part})` : part)), condition].join(' and ');
}

/** What to add to and take from runs so that each has the tags that are wanted of all. */
export function changeOf(wanted: ReadonlyMap<string, boolean>): {
  add: string[];
  remove: string[];
} {
  const tags = [...wanted];
  return {
    add: tags.filter(([, on]) => on).map(([tag]) => tag),
    remove: tags.filter(([, on]) => !on).map(([tag]) => tag),
  };
}
