/** A heat map as rows and cells, with empty ones where no run is, and colours that text can be read on. */

import type { ConfigValue, Heatmap, HeatmapCell } from '../api/types';
import { contrast, ramp, type ThemeName } from '../colour';

export interface ShownCell {
  cell: HeatmapCell | null;
  background: string;
  text: string;
}

export interface ShownRow {
  y: ConfigValue;
  cells: ShownCell[];
}

/* From low to high, one hue, even steps of lightness. */
export const RAMPS: Record<ThemeName, readonly string[]> = {
  light: ['#f1f5fb', '#bcd4ee', '#7fb0de', '#3f86c6', '#145a9e', '#0b3566'],
  dark: ['#16202c', '#1b3a5b', '#22588c', '#3a7fbd', '#6fabe0', '#b5d6f5'],
};
const INKS = ['#10131a', '#ffffff'] as const;

/** Lowest and highest mean; null when there is no cell. */
export function extremes({ cells }: Heatmap): [number, number] | null {
  const means = cells.map((cell) => cell.mean).filter((mean) => mean !== null);
  return means.length > 0 ? [Math.min(...means), Math.max(...means)] : null;
}

/** Rows from the largest y down, as an axis has it. */
export function rowsOf(map: Heatmap, theme: ThemeName): ShownRow[] {
  const found = new Map(map.cells.map((cell) => [JSON.stringify([cell.x, cell.y]), cell]));
  const [low, high] = extremes(map) ?? [0, 0];
  return [...map.y.values].reverse().map((y) => ({
    y,
    cells: map.x.values.map((x) => {
      const cell = found.get(JSON.stringify([x, y])) ?? null;
      if (cell === null || cell.mean === null) return { cell: null, background: '', text: '' };
      const share = high > low ? (cell.mean - low) / (high - low) : 0.5;
      const background = ramp(RAMPS[theme], share);
      const [dark, light] = INKS;
      return {
        cell,
        background,
        text: contrast(dark, background) >= contrast(light, background) ? dark : light,
      };
    }),
  }));
}
