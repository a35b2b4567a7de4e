/** What of x and y a chart shows. */

import uPlot from 'uplot';

export type Range = [number, number];

const ROOM = 0.1; // above and below the values, as uPlot leaves it

/** A range of x that can be drawn, also for one point or none. */
export function widened(low: number | null, high: number | null): Range {
  if (low === null || high === null) return [0, 1];
  return low === high ? [low - 1, high + 1] : [low, high];
}

/**
 * A range of y with room around the values. One value alone gets a tenth of itself on either side, and zeros one unit:
 * uPlot would show twice the value, and a hundred, which is 10,000 % of a share.
 */
export function rangeOfValues(low: number | null, high: number | null): uPlot.Range.MinMax {
  if (low === null || high === null) return [null, null];
  if (low === 0 && high === 0) return [0, 1];
  if (low === high) return [low - ROOM * Math.abs(low), low + ROOM * Math.abs(low)];
  return uPlot.rangeNum(low, high, ROOM, true);
}
