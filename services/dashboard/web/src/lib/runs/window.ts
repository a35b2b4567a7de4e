/** Which rows of a long table are worth having in the page. */

export interface RowWindow {
  first: number;
  end: number; // behind the last one
  beforePx: number;
  afterPx: number;
}

const SPARE_ROWS = 8;

/** The rows that are seen, with some to spare on both sides, and the heights that stand for all others. */
export function rowWindow(
  scrollPx: number,
  viewPx: number,
  rowPx: number,
  rows: number,
): RowWindow {
  const seen = Math.ceil(viewPx / rowPx);
  const top = Math.min(Math.floor(Math.max(0, scrollPx) / rowPx), Math.max(0, rows - seen));
  const first = Math.max(0, top - SPARE_ROWS);
  const end = Math.min(rows, top + seen + SPARE_ROWS);
  return { first, end, beforePx: first * rowPx, afterPx: (rows - end) * rowPx };
}
