/**
 * Whether a list that grows at its end is followed there. Only what the reader does ends that: the place of the scroll
 * bar also moves when lines come, wrap or leave.
 */

/** How long a turn of the wheel or a key goes on moving the list. */
const INTENT_MS = 500;

export class Following {
  #on = true;
  #held = false;
  #untilMs = -Infinity;

  get on(): boolean {
    return this.#on;
  }

  /** The reader turned the wheel, pressed a key or swiped. */
  moved(nowMs: number): void {
    this.#untilMs = nowMs + INTENT_MS;
  }

  /** The reader holds the scroll bar or a selection, or lets go of it. */
  hold(held: boolean, nowMs: number): void {
    this.#held = held;
    if (!held) this.moved(nowMs);
  }

  /** The list stands elsewhere now; returns whether it is to be brought back to its end. */
  scrolled(atEnd: boolean, nowMs: number): boolean {
    if (this.#held || nowMs < this.#untilMs) this.#on = atEnd;
    return this.#on && !atEnd;
  }

  /** The reader wants to see the end again. */
  resume(): void {
    this.#on = true;
    this.#untilMs = -Infinity;
  }
}
