/**
 * Loads again when asked, one load at a time and not more often than `everyMs`: any number of requests in
 * between make one more load, which sees what the last of them was about.
 */
export class Refresh {
  #wanted = false;
  #loading = false;
  #timer: ReturnType<typeof setTimeout> | undefined;
  #stopped = false;
  #nextAtMs = 0;

  /** @param load - must not throw; what it waits for ends with the signal. */
  constructor(
    private readonly load: (signal: AbortSignal) => Promise<void>,
    private readonly everyMs = 500,
  ) {}

  readonly #abort = new AbortController();

  request(): void {
    this.#wanted = true;
    this.#next();
  }

  /** Loads again at once, or when what is loading now is there. */
  now(): void {
    this.#nextAtMs = 0;
    this.request();
  }

  /** Ends for good. */
  stop(): void {
    this.#stopped = true;
    clearTimeout(this.#timer);
    this.#abort.abort();
  }

  #next(): void {
    if (this.#stopped || this.#loading || !this.#wanted) return;
    clearTimeout(this.#timer);
    const waitMs = this.#nextAtMs - Date.now();
    if (waitMs > 0) {
      this.#timer = setTimeout(() => this.#next(), waitMs);
      return;
    }
    this.#wanted = false;
    this.#loading = true;
    this.#nextAtMs = Date.now() + this.everyMs;
    void this.load(this.#abort.signal).finally(() => {
      this.#loading = false;
      this.#next();
    });
  }
}
