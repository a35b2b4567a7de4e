/** The server's time, once a second while the page is seen: what ages are counted from. */

import { Value, type Observable } from './observable';

export class Ticker {
  readonly #now: Value<number>;

  /** @param nowUnixS - the server's time as well as it is known. */
  constructor(
    private readonly nowUnixS: () => number,
    private readonly page: Pick<Document, 'hidden' | 'addEventListener'> = document,
  ) {
    this.#now = new Value(nowUnixS());
    setInterval(() => this.#tick(), 1000);
    page.addEventListener('visibilitychange', () => this.#tick());
  }

  /** Unix time in seconds. */
  get now(): Observable<number> {
    return this.#now;
  }

  #tick(): void {
    if (!this.page.hidden) this.#now.set(this.nowUnixS());
  }
}
