/** A run's log under a filter: the newest lines, older ones page by page, and what is said meanwhile. */

import { asProblem, type Problem } from '../api/problem';
import type { LogPage, LogQuery, LogRecord } from '../api/records';
import { Value, type Observable } from '../observable';
import { linesOf, LONGEST_TAIL, matches, merge, type LogFilter, type LogLine } from './tail';

const PAGE = 200;
const LARGE_PAGE = 1000;
/** Pages without a line that are read on end before somebody is asked whether to go on. */
const EMPTY_PAGES = 20;

export interface LogState {
  lines: readonly LogLine[];
  /** That have a log, whatever the filter. */
  services: readonly string[];
  /** Whether the server has older lines that were not read. */
  older: boolean;
  loading: boolean;
  problem: Problem | null;
}

export type FetchLog = (query: LogQuery, signal: AbortSignal) => Promise<LogPage>;

export class RunLog {
  readonly #state = new Value<LogState>({
    lines: [],
    services: [],
    older: false,
    loading: true,
    problem: null,
  });
  readonly #abort = new AbortController();
  #cursor: string | null = null;

  constructor(
    private readonly fetch: FetchLog,
    readonly filter: LogFilter,
  ) {}

  get state(): Observable<LogState> {
    return this.#state;
  }

  /** Reads the newest lines; those that are known stay. */
  async start(): Promise<void> {
    await this.#read(null);
  }

  /** Reads on to the past until lines come, or there are none. */
  async readOlder(): Promise<void> {
    if (this.#cursor !== null && !this.#state.value.loading) await this.#read(this.#cursor);
  }

  /** Takes in what was said meanwhile; returns how many of these lines are new and meet the filter. */
  take(records: readonly LogRecord[]): number {
    const wanted = linesOf(records).filter((line) => matches(line, this.filter));
    const before = this.#state.value.lines;
    const known = new Set(before.map((line) => line.id));
    const fresh = wanted.filter((line) => !known.has(line.id));
    if (fresh.length > 0) this.#set({ lines: merge(before, fresh) });
    return fresh.length;
  }

  /** All lines that meet the filter, oldest first, up to `most`; `progress` hears how many were read. */
  async all(
    most: number,
    progress: (n: number) => void,
  ): Promise<{ lines: LogLine[]; complete: boolean }> {
    const found: LogRecord[] = [];
    let cursor: string | null = null;
    do {
      const page: LogPage = await this.#page(cursor, LARGE_PAGE);
      found.push(...page.items);
      cursor = page.next_cursor;
      progress(found.length);
    } while (cursor !== null && found.length < most);
    return { lines: linesOf(found.reverse()), complete: cursor === null };
  }

  stop(): void {
    this.#abort.abort();
  }

  async #read(cursor: string | null): Promise<void> {
    this.#set({ loading: true, problem: null });
    const anew = cursor === null;
    try {
      for (let pages = 0; pages < EMPTY_PAGES; pages += 1) {
        const page = await this.#page(cursor, PAGE);
        if (this.#abort.signal.aborted) return;
        cursor = page.next_cursor;
        // After a lost connection what was read before stays, and so does the place from which older lines go on.
        if (!anew || this.#cursor === null) this.#cursor = cursor;
        const lines = merge(this.#state.value.lines, linesOf(page.items.toReversed()));
        const older = this.#cursor !== null && lines.length < LONGEST_TAIL;
        this.#set({ lines, services: page.services, older });
        if (page.items.length > 0 || cursor === null) break;
      }
    } catch (error) {
      if (this.#abort.signal.aborted) return;
      this.#set({ problem: asProblem(error) });
    }
    this.#set({ loading: false });
  }

  #page(cursor: string | null, limit: number): Promise<LogPage> {
    const { service, level, search } = this.filter;
    const query: LogQuery = { limit };
    if (service) query.service = service;
    if (level) query.level = level;
    if (search) query.search = search;
    if (cursor) query.cursor = cursor;
    return this.fetch(query, this.#abort.signal);
  }

  #set(change: Partial<LogState>): void {
    this.#state.set({ ...this.#state.value, ...change });
  }
}
