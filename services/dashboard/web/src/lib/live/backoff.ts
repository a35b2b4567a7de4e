/**
 * Seconds to wait before the attempt-th reconnection in a row (from 0): doubles from 1 to 30, and a random
 * half of it, so that the tabs of a restarted server do not all come back at once.
 */
export function backoffS(attempt: number, random: () => number = Math.random): number {
  const longest = Math.min(30, 2 ** Math.min(attempt, 10));
  return longest * (0.5 + random() / 2);
}
