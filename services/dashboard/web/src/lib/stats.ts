/** Counters of this page, for people with a console and for tests: `window.__dash.stats()`. */

const counters = new Map<string, number>();

/** Adds to a counter. */
export function count(name: string, by = 1): void {
  counters.set(name, (counters.get(name) ?? 0) + by);
}

/** Sets a gauge, such as the newest latency. */
export function gauge(name: string, value: number): void {
  counters.set(name, value);
}

export function stats(): Record<string, number> {
  return Object.fromEntries(counters);
}

declare global {
  interface Window {
    __dash: { stats: typeof stats };
  }
}

export function exposeStats(): void {
  window.__dash = { stats };
}
