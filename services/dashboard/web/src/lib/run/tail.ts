/** The newest lines of a log, bounded; what arrives while the reader looks at older ones is counted. */

export const LONGEST_TAIL = 10_000;

export interface LogLine {
  id: number;
  timeUnixS: number | null;
  level: string;
  service: string;
  message: string;
}

export interface LogFilter {
  service: string;
  level: string;
  search: string;
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

/** Adds lines that are new by id, in their order, and drops the oldest beyond the bound. */
export function append(
  lines: readonly LogLine[],
  more: readonly LogLine[],
  longest: number = LONGEST_TAIL,
): LogLine[] {
  const newest = lines.at(-1)?.id ?? -Infinity;
  const added = more.filter((line) => line.id > newest);
  return [...lines, ...added].slice(-longest);
}
