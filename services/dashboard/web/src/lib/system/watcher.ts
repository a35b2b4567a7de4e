/** The newest topology: from the live hub, and by REST until it has spoken. */

import type { ApiClient } from '../api/client';
import { asProblem, type Problem } from '../api/problem';
import type { LiveClient } from '../live/client';
import { topics } from '../live/topics';
import { Value, type Observable } from '../observable';
import type { Topology } from './topology';

export class TopologyWatcher {
  readonly #topology = new Value<Topology | null>(null);
  readonly #problem = new Value<Problem | null>(null);
  readonly #unsubscribe: () => void;

  constructor(
    private readonly api: ApiClient,
    live: LiveClient,
  ) {
    this.#unsubscribe = live.subscribe(topics.topology, {
      onData: (data) => this.#topology.set(data as Topology),
    });
    this.reload();
  }

  get topology(): Observable<Topology | null> {
    return this.#topology;
  }

  get problem(): Observable<Problem | null> {
    return this.#problem;
  }

  reload(): void {
    void this.#load();
  }

  stop(): void {
    this.#unsubscribe();
  }

  async #load(): Promise<void> {
    try {
      const loaded = await this.api.get<Topology>('/system/topology');
      const known = this.#topology.value;
      if (known === null || loaded.time_unix_s > known.time_unix_s) this.#topology.set(loaded);
      this.#problem.set(null);
    } catch (error) {
      this.#problem.set(asProblem(error));
    }
  }
}
