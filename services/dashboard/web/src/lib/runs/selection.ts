/** Which runs are chosen. */

export type Selection = ReadonlySet<string>;

export function toggled(selection: Selection, id: string): Selection {
  const next = new Set(selection);
  if (!next.delete(id)) next.add(id);
  return next;
}

/** Everything between two rows takes the state that the last one gets. */
export function toggledRange(
  selection: Selection,
  ids: readonly string[],
  from: string | null,
  to: string,
): Selection {
  const [start, end] = [from === null ? -1 : ids.indexOf(from), ids.indexOf(to)];
  if (start < 0 || end < 0) return toggled(selection, to);
  const chosen = !selection.has(to);
  const next = new Set(selection);
  for (const id of ids.slice(Math.min(start, end), Math.max(start, end) + 1)) {
    if (chosen) next.add(id);
    else next.delete(id);
  }
  return next;
}
