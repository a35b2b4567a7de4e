/** A long list of runs, read page by page as far as somebody looks, and kept up to date in place. */

import { asProblem, type Problem } from '../api/problem';
import type { Run, RunPage, RunQuery } from '../api/types';
import type { RunChange } from '../live/topics';
import { Value, type Observable } from '../observable';

export const PAGE_SIZE = 200;

export interface RunsState {
  rows: readonly Run[];
  /** How many runs meet the query; null: not known yet. */
  total: number | null;
  loading: boolean;
  problem: Problem | null;
  /** Runs that were made since the list was read and are not in it. */
  newer: number;
}

export type Fetch = (query: RunQuery, signal: AbortSignal) => Promise<RunPage>;

export class RunList {
  readonly #state = new Value<RunsState>({
    rows: [],
    total: null,
    loading: true,
    problem: null,
    newer: 0,
  });
  #query: RunQuery | null = null;
  #cursor: string | null = null;
  #wanted = PAGE_SIZE;
  #running: AbortController | null = null;
  #index = new Map<string, number>();
  readonly #unknown = new Set<string>();

  constructor(private readonly fetch: Fetch) {}

  get state(): Observable<RunsState> {
    return this.#state;
  }

  /** Shows what meets another query; what is shown stays until the first answer. */
  show(query: RunQuery): void {
    this.#query = query;
    this.#wanted = PAGE_SIZE;
    void this.#load(true);
  }

  /** Reads on until `count` rows are there, or all. */
  ensure(count: number): void {
    this.#wanted = Math.max(this.#wanted, Math.min(count, this.#state.value.total ?? count));
    if (!this.#running && !this.#complete && !this.#state.value.problem) void this.#load(false);
  }

  /** Reads all again that was read, for example after the connection was lost. */
  refresh(): void {
    if (!this.#query) return;
    this.#wanted = Math.max(PAGE_SIZE, this.#state.value.rows.length);
    void this.#load(true);
  }

  /** Puts a changed run in place. It keeps its row, so that nothing moves under the pointer. */
  apply(change: Partial<Run> & RunChange): void {
    if (change.removed) {
      this.#unknown.delete(change.id);
      this.remove(new Set([change.id]));
      return;
    }
    const state = this.#state.value;
    const at = this.#index.get(change.id);
    if (at === undefined) {
      if (state.total === null || change.archived_at_unix_s || this.#unknown.has(change.id)) return;
      this.#unknown.add(change.id);
      this.#set({ newer: this.#unknown.size });
      return;
    }
    const before = state.rows[at];
    if (!before || (change.rev !== undefined && change.rev < before.rev)) return;
    this.#set({ rows: state.rows.with(at, { ...before, ...change, values: before.values }) });
  }

  /** Takes runs out of the list that no longer belong to it, such as archived or removed ones. */
  remove(ids: ReadonlySet<string>): void {
    const { rows, total } = this.#state.value;
    const kept = rows.filter((run) => !ids.has(run.id));
    this.#put(kept, {
      total: total === null ? null : total - (rows.length - kept.length),
      newer: this.#unknown.size,
    });
  }

  stop(): void {
    this.#running?.abort();
  }

  get #complete(): boolean {
    const { rows, total } = this.#state.value;
    return total !== null && (this.#cursor === null || rows.length >= total);
  }

  async #load(anew: boolean): Promise<void> {
    this.#running?.abort();
    const running = new AbortController();
    this.#running = running;
    this.#set({ loading: true, problem: null });
    let rows: readonly Run[] = anew ? [] : this.#state.value.rows;
    let cursor = anew ? null : this.#cursor;
    try {
      do {
        const query = { ...this.#query, limit: PAGE_SIZE, ...(cursor ? { cursor } : {}) };
        const page = await this.fetch(query, running.signal);
        if (running.signal.aborted) return;
        rows = [...rows, ...page.items];
        cursor = page.next_cursor;
        this.#cursor = cursor;
        if (anew) this.#unknown.clear();
        anew = false;
        this.#put(rows, { total: page.total, newer: this.#unknown.size });
      } while (cursor !== null && rows.length < this.#wanted);
    } catch (error) {
      if (running.signal.aborted) return;
      this.#set({ problem: asProblem(error) });
    }
    this.#running = null;
    this.#set({ loading: false });
  }

  #put(rows: readonly Run[], change: Partial<RunsState>): void {
    this.#index = new Map(rows.map((run, at) => [run.id, at]));
    this.#set({ rows, ...change });
  }

  #set(change: Partial<RunsState>): void {
    this.#state.set({ ...this.#state.value, ...change });
  }
}
