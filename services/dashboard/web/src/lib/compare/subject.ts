/** The runs behind a comparison: their names and configurations. */

import type { ApiClient } from '../api/client';
import type { Run } from '../api/types';
import { PAGE_SIZE } from '../runs/list';
import type { Subject } from './view';

export interface SubjectRuns {
  runs: Run[];
  /** Of all that meet the filter; more than `runs` when not all were read. */
  total: number;
  /** Ids that the server does not know. */
  unknown: string[];
}

const MOST = 1000;

/** Reads the runs; figures do not depend on how many of them are read here. */
export async function readSubject(
  api: ApiClient,
  subject: Subject,
  signal: AbortSignal,
): Promise<SubjectRuns> {
  if (subject.runs) return readChosen(api, subject.runs, signal);
  const runs: Run[] = [];
  let cursor: string | null = null;
  let total = 0;
  do {
    const next: string | null = cursor;
    const page = await api.runs.page(
      { ...subject.filter, limit: PAGE_SIZE, ...(next ? { cursor: next } : {}) },
      signal,
    );
    runs.push(...page.items);
    cursor = page.next_cursor;
    total = page.total;
  } while (cursor !== null && runs.length < MOST);
  return { runs, total, unknown: [] };
}

async function readChosen(
  api: ApiClient,
  ids: readonly string[],
  signal: AbortSignal,
): Promise<SubjectRuns> {
  const found = await Promise.allSettled(ids.map((id) => api.runs.get(id, signal)));
  const runs: Run[] = [];
  const unknown: string[] = [];
  found.forEach((result, i) => {
    if (result.status === 'fulfilled') runs.push(result.value);
    else if (result.reason?.status === 404) unknown.push(ids[i] ?? '');
    else throw result.reason;
  });
  return { runs, total: runs.length, unknown };
}
