/** Tables as CSV (RFC 4180), and files from the page. */

import type { Line } from './plan';

type Cell = string | number | null | undefined;

export function csv(header: readonly string[], rows: Iterable<readonly Cell[]>): string {
  const lines = [header, ...rows].map((row) => row.map(quoted).join(','));
  return lines.join('\r\n') + '\r\n';
}

function quoted(cell: Cell): string {
  if (cell === null || cell === undefined) return '';
  // What a spreadsheet would take for a formula is a text.
  const text = typeof cell === 'string' && /^[=+\-@\t\r\n]/.test(cell) ? `'${cell}` : String(cell);
  return /[",\r\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
}

/** All points of a chart, unsmoothed, one row per line and x. */
export function chartCsv(lines: readonly Line[], xName: string, yName: string): string {
  function* rows(): Generator<Cell[]> {
    for (const line of lines) {
      for (const [i, x] of line.x.entries()) {
        yield [line.label, x, line.value[i], line.low?.[i], line.high?.[i], line.n?.[i]];
      }
    }
  }
  return csv(['line', xName, yName, 'low', 'high', 'seeds'], rows());
}

/** Lets the user save a file that was made in the page. */
export function save(name: string, content: Blob | string): void {
  const blob = typeof content === 'string' ? new Blob([content], { type: 'text/csv' }) : content;
  const url = URL.createObjectURL(blob);
  const link = document.createElement('a');
  link.href = url;
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(url), 60_000);
}

/** A text as the name of a file. */
export function fileName(text: string, extension: string): string {
  return `${
    text
      .replace(/[^\p{L}\p{N}]+/gu, '-')
      .replace(/^-|-$/g, '')
      .toLowerCase() || 'chart'
  }.${extension}`;
}
