/** What of x and y a chart shows. */

import uPlot from 'uplot';

export type Range = [number, number];

const ROOM = 0.1; // above and below the values, as uPlot leaves it

/** A range of x that can be drawn, also for one point or none. */
export function widened(low: number | null, high: number | null): Range {
  if (low === null || high === null) return [0, 1];
  return low === high ? [low - 1, high + 1] : [low, high];
}

/** A range of y with room around the values. Zeros alone get one unit: uPlot's hundred would be 10,000 % of a share. */
export function rangeOfValues(low: number | null, high: number | null): uPlot.Range.MinMax {
  if (low === null || high === null) return [null, null];
  return low === 0 && high === 0 ? [0, 1] : uPlot.rangeNum(low, high, ROOM, true);
}
