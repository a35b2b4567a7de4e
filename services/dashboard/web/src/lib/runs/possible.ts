/** What can be done with a run as it stands: the rules of the server, so that no button is offered that it refuses. */

import type { BulkAction, Run } from '../api/types';

type Standing = Pick<Run, 'state' | 'desired_state' | 'archived_at_unix_s'>;

const OVER = ['finished', 'failed'];
const IDLE = [...OVER, 'stopped'];

export function isOver(run: Pick<Run, 'state'>): boolean {
  return IDLE.includes(run.state);
}

export function isPossible(action: BulkAction, run: Standing): boolean {
  const idle = isOver(run);
  switch (action) {
    case 'stop':
      return !idle && run.desired_state === 'running';
    case 'resume':
      return idle && run.state !== 'finished' && !run.archived_at_unix_s;
    case 'archive':
      return idle && !run.archived_at_unix_s;
    case 'unarchive':
      return Boolean(run.archived_at_unix_s);
    case 'remove':
      return idle;
    case 'restore':
      return false; // it is no run while it is in the trash
  }
}

/** Whether what was asked for is so; null: there is no such run any more. */
export function isDone(action: BulkAction, run: Standing | null): boolean {
  if (run === null) return action === 'remove';
  switch (action) {
    case 'stop':
      return run.desired_state === 'stopped' || OVER.includes(run.state);
    case 'resume':
      return run.desired_state === 'running';
    case 'archive':
      return Boolean(run.archived_at_unix_s);
    case 'unarchive':
      return !run.archived_at_unix_s;
    case 'remove':
      return false;
    case 'restore':
      return true;
  }
}
