/**
 * The server's clock, so that ages are right on a browser whose own clock is wrong. Of the stamps that
 * arrived lately, the fastest one errs the least: it is late by its journey only.
 */
export class ServerClock {
  private offsetS = 0;
  private known = false;
  private agedAtS = 0;

  constructor(private readonly localUnixS: () => number = () => Date.now() / 1000) {}

  /** A message with the server's stamp has just arrived. */
  observe(serverUnixS: number): void {
    const local = this.localUnixS();
    const offsetS = serverUnixS - local;
    const stale = local - this.agedAtS > FORGET_AFTER_S || local < this.agedAtS;
    if (!this.known || stale || offsetS >= this.offsetS) {
      this.offsetS = offsetS;
      this.agedAtS = local;
      this.known = true;
    }
  }

  /** The server's time now (unix time, seconds). */
  nowUnixS(): number {
    return this.localUnixS() + this.offsetS;
  }
}

const FORGET_AFTER_S = 60;
