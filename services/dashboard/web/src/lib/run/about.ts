/** What people say about a run, while two of them edit it. */

import type { Run } from '../api/types';

export type About = Pick<Run, 'name' | 'notes' | 'tags'>;
export type AboutField = keyof About;

const FIELDS: readonly AboutField[] = ['name', 'notes', 'tags'];

function same(one: About, other: About, field: AboutField): boolean {
  return String(one[field]) === String(other[field]);
}

/** The fields that somebody changed, alone: what stays as it was is nobody's business to write. */
export function changesOf(before: About, now: About): Partial<About> {
  const changed = FIELDS.filter((field) => !same(before, now, field));
  return Object.fromEntries(changed.map((field) => [field, now[field]]));
}

/** Takes in what somebody else changed; where both changed a field, mine stands and the other is a conflict. */
export function rebased(
  before: About,
  mine: About,
  theirs: About,
): { mine: About; conflicts: AboutField[] } {
  const conflicts: AboutField[] = [];
  const merged: About = { name: mine.name, notes: mine.notes, tags: mine.tags };
  for (const field of FIELDS) {
    if (same(before, theirs, field) || same(mine, theirs, field)) continue;
    if (same(before, mine, field)) Object.assign(merged, { [field]: theirs[field] });
    else conflicts.push(field);
  }
  return { mine: merged, conflicts };
}
