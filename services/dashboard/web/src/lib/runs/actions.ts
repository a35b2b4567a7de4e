/** What people do to runs, one or many: every action says how far it is and what came of it, and can be taken back. */

import type { ApiClient } from '../api/client';
import { asProblem, Problem } from '../api/problem';
import type { BulkAction, BulkResult } from '../api/types';
import { integer, plural } from '../format';
import type { Toasts } from '../toasts';
import { isDone } from './possible';

/** So few that even a slow disk is done with them well within the deadline of a request. */
const CHUNK = 50;
/** How often it is looked what became of runs whose answer was lost: the server may be at them still. */
const LOOKS = 5;
const LOOK_AGAIN_MS = 3000;

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
    private readonly api: Pick<ApiClient, 'runs'>,
    private readonly toasts: Toasts,
    /** Hears of the runs for which an action succeeded. */
    private readonly changed: (ids: ReadonlySet<string>, action: BulkAction) => void,
    private readonly lookAgainMs = LOOK_AGAIN_MS,
  ) {}

  async act(action: BulkAction, ids: readonly string[], undoable = true): Promise<void> {
    const done: string[] = [];
    const refusals = new Map<string, number>();
    const total = plural(ids.length, 'run');
    let cancelled = false;
    let failure: unknown = null;
    let at = 0;
    const progress =
      ids.length > CHUNK ? this.toasts.progress(`${total}: begun`, () => (cancelled = true)) : null;
    try {
      for (; at < ids.length && !cancelled; at += CHUNK) {
        for (const { id, ok, problem } of await this.#some(action, ids.slice(at, at + CHUNK))) {
          if (ok) done.push(id);
          else {
            const why = problem?.detail || problem?.title || 'refused';
            refusals.set(why, (refusals.get(why) ?? 0) + 1);
          }
        }
        progress?.say(`${integer(done.length)} of ${total} ${DONE[action]}`);
      }
    } catch (error) {
      failure = error;
    }
    progress?.end();
    const left = ids.length - Math.min(at, ids.length);
    if (failure) this.toasts.failed(`${plural(left, 'run')}: not ${DONE[action]}`, failure);
    for (const [why, n] of refusals) {
      this.toasts.failed(`${plural(n, 'run')}: not ${DONE[action]}`, new Problem(409, why));
    }
    if (done.length === 0) return;
    this.changed(new Set(done), action);
    const undo = undoable ? () => void this.act(UNDO[action], done, false) : undefined;
    const rest = cancelled && left > 0 ? `, ${integer(left)} left as they were` : '';
    this.toasts.done(`${plural(done.length, 'run')} ${DONE[action]}${rest}`, undo);
  }

  /** Some of them; where the answer is lost, what is to be seen of them. */
  async #some(action: BulkAction, ids: readonly string[]): Promise<BulkResult[]> {
    try {
      return (await this.api.runs.bulk(action, [...ids])).results;
    } catch (error) {
      if (!asProblem(error).offline) throw error;
      return await this.#seen(action, ids, error);
    }
  }

  async #seen(action: BulkAction, ids: readonly string[], lost: unknown): Promise<BulkResult[]> {
    let waiting = [...ids];
    for (let look = 0; look < LOOKS && waiting.length > 0; look += 1) {
      await new Promise((resolve) => setTimeout(resolve, look === 0 ? 0 : this.lookAgainMs));
      const undone: string[] = [];
      for (const id of waiting) if (!(await this.#isDone(action, id))) undone.push(id);
      waiting = undone;
    }
    if (waiting.length === ids.length) throw lost; // nothing of it was done
    return ids.map((id) => ({ id, ok: !waiting.includes(id) }));
  }

  async #isDone(action: BulkAction, id: string): Promise<boolean> {
    try {
      return isDone(action, await this.api.runs.get(id));
    } catch (error) {
      if (asProblem(error).status === 404) return isDone(action, null);
      throw error;
    }
  }
}
