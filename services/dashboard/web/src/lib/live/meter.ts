/** Events per second over the last two seconds, for "fps" labels. */
export class RateMeter {
  private readonly timesMs: number[] = [];

  constructor(private readonly windowMs = 2000) {}

  add(nowMs: number): void {
    this.timesMs.push(nowMs);
    this.forget(nowMs);
  }

  /** Events per second; 0 when the last one is older than the window. */
  perSecond(nowMs: number): number {
    this.forget(nowMs);
    return this.timesMs.length / (this.windowMs / 1000);
  }

  private forget(nowMs: number): void {
    while (this.timesMs.length > 0 && this.timesMs[0]! <= nowMs - this.windowMs) {
      this.timesMs.shift();
    }
  }
}
