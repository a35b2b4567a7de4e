/** The newest lines of a log, bounded; what arrives while the reader looks at older ones is counted. */

import type { LogRecord } from '../api/records';

export const LONGEST_TAIL = 10_000;

export interface LogLine {
  /** `<log>:<byte offset>`: unique in the run. */
  id: string;
  timeUnixS: number | null;
  /** By which lines are ordered. */
  orderUnixS: number;
  level: string;
  service: string;
  message: string;
}

export interface LogFilter {
  service: string;
  level: string;
  search: string;
}

/** One line of text of what a service said: a traceback has many, each of which is a row of its own. */
export interface LogRow {
  key: string;
  line: LogLine;
  text: string;
  first: boolean;
}

export function rowsOf(lines: readonly LogLine[]): LogRow[] {
  return lines.flatMap((line) =>
    line.message
      .split(/\r\n|[\n\v\f\r\u0085\u2028\u2029]/)
      .map((text, i) => ({ key: `${line.id}+${i}`, line, text, first: i === 0 })),
  );
}

/** Log levels from least to most severe. */
export const LEVELS = ['DEBUG', 'INFO', 'WARNING', 'ERROR', 'CRITICAL'] as const;

/** Whether a line passes: of this service, at least this level, containing the text (any case). */
export function matches(line: LogLine, filter: LogFilter): boolean {
  if (filter.service !== '' && line.service !== filter.service) return false;
  if (filter.level !== '' && severity(line.level) < severity(filter.level)) return false;
  return filter.search === '' || line.message.toLowerCase().includes(filter.search.toLowerCase());
}

function severity(level: string): number {
  return LEVELS.indexOf(level as (typeof LEVELS)[number]);
}

/** Lines as the server sends them, oldest first; one without a time of its own stands with the one before it. */
export function linesOf(records: readonly LogRecord[]): LogLine[] {
  let orderUnixS = 0;
  return records.map(({ id, time_unix_s, level, service, message }) => {
    orderUnixS = time_unix_s ?? orderUnixS;
    return { id, timeUnixS: time_unix_s, orderUnixS, level, service, message };
  });
}

/** All lines, each once, by time; beyond the bound the oldest are dropped. */
export function merge(
  lines: readonly LogLine[],
  more: readonly LogLine[],
  longest: number = LONGEST_TAIL,
): LogLine[] {
  const known = new Set(lines.map((line) => line.id));
  const all = [...lines, ...more.filter((line) => !known.has(line.id))];
  all.sort((one, other) => one.orderUnixS - other.orderUnixS);
  return all.slice(-longest);
}
