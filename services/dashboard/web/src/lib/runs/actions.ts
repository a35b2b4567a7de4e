/** What people do to runs, one or many: every action says what came of it and can be taken back. */

import type { ApiClient } from '../api/client';
import { Problem } from '../api/problem';
import type { BulkAction } from '../api/types';
import { plural } from '../format';
import type { Toasts } from '../toasts';

const MOST_IDS = 1000;

const DONE: Record<BulkAction, string> = {
  stop: 'asked to stop',
  resume: 'queued again',
  archive: 'archived',
  unarchive: 'back from the archive',
  remove: 'moved to the trash',
  restore: 'back from the trash',
};
const UNDO: Record<BulkAction, BulkAction> = {
  stop: 'resume',
  resume: 'stop',
  archive: 'unarchive',
  unarchive: 'archive',
  remove: 'restore',
  restore: 'remove',
};

export class RunActions {
  constructor(
    private readonly api: ApiClient,
    private readonly toasts: Toasts,
    /** Hears of the runs for which an action succeeded. */
    private readonly changed: (ids: ReadonlySet<string>, action: BulkAction) => void,
  ) {}

  async act(action: BulkAction, ids: readonly string[], undoable = true): Promise<void> {
    const done: string[] = [];
    const refusals = new Map<string, number>();
    try {
      for (let at = 0; at < ids.length; at += MOST_IDS) {
        const { results } = await this.api.runs.bulk(action, ids.slice(at, at + MOST_IDS));
        for (const { id, ok, problem } of results) {
          if (ok) done.push(id);
          else {
            const why = problem?.detail || problem?.title || 'refused';
            refusals.set(why, (refusals.get(why) ?? 0) + 1);
          }
        }
      }
    } catch (error) {
      this.toasts.failed(`${plural(ids.length - done.length, 'run')}: not ${DONE[action]}`, error);
    }
    for (const [why, n] of refusals) {
      this.toasts.failed(`${plural(n, 'run')}: not ${DONE[action]}`, new Problem(409, why));
    }
    if (done.length === 0) return;
    this.changed(new Set(done), action);
    const undo = undoable ? () => void this.act(UNDO[action], done, false) : undefined;
    this.toasts.done(`${plural(done.length, 'run')} ${DONE[action]}`, undo);
  }
}
