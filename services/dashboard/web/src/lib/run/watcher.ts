/** One run, kept as new as the server knows it: read by REST, again whenever the live hub says that it changed. */

import type { ApiClient } from '../api/client';
import { asProblem, type Problem } from '../api/problem';
import type { Run } from '../api/types';
import type { LiveClient } from '../live/client';
import { topics, type RunChange } from '../live/topics';
import { Value, type Observable } from '../observable';
import { Refresh } from '../refresh';

export class RunWatcher {
  readonly #run = new Value<Run | null>(null);
  readonly #problem = new Value<Problem | null>(null);
  readonly #refresh: Refresh;
  readonly #unsubscribe: () => void;

  constructor(
    private readonly api: ApiClient,
    live: LiveClient,
    readonly id: string,
  ) {
    this.#refresh = new Refresh((signal) => this.#load(signal));
    this.#unsubscribe = live.subscribe(topics.runs, {
      onData: (data) => {
        if ((data as RunChange).id === id) this.reload();
      },
      onGap: () => this.reload(),
    });
    this.reload();
  }

  get run(): Observable<Run | null> {
    return this.#run;
  }

  /** Why the run could not be read; null when it was. */
  get problem(): Observable<Problem | null> {
    return this.#problem;
  }

  reload(): void {
    this.#refresh.request();
  }

  /** The run as an answer to a change of ours has it. */
  take(run: Run): void {
    const known = this.#run.value;
    if (known === null || run.rev >= known.rev) this.#run.set(run);
  }

  stop(): void {
    this.#refresh.stop();
    this.#unsubscribe();
  }

  async #load(signal: AbortSignal): Promise<void> {
    try {
      this.take(await this.api.runs.get(this.id, signal));
      this.#problem.set(null);
    } catch (error) {
      if (signal.aborted) return;
      const problem = asProblem(error);
      if (problem.status === 404) this.#run.set(null); // removed; what was shown is no more
      this.#problem.set(problem);
    }
  }
}
