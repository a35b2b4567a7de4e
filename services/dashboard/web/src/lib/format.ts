/** Numbers as people read them: units, SI prefixes, ages. A missing number is an en dash. */

export const MISSING = '–';
const THIN = '\u202f'; // narrow no-break space between number and unit
const MINUS = '\u2212';

type MaybeNumber = number | null | undefined;

function isMissing(value: MaybeNumber): value is null | undefined {
  return value === null || value === undefined || Number.isNaN(value);
}

function signed(text: string): string {
  return text.startsWith('-') ? MINUS + text.slice(1) : text;
}

/** A number with `digits` significant digits, grouped by thousands, without a trailing exponent where avoidable. */
export function number(value: MaybeNumber, digits = 4): string {
  if (isMissing(value)) return MISSING;
  if (!Number.isFinite(value)) return value > 0 ? '∞' : `${MINUS}∞`;
  const size = Math.abs(value);
  if (size !== 0 && (size < 1e-4 || size >= 1e9))
    return signed(value.toExponential(Math.max(0, digits - 2)));
  const decimals = size === 0 ? 0 : Math.max(0, digits - 1 - Math.floor(Math.log10(size)));
  return signed(value.toLocaleString('en-US', { maximumFractionDigits: Math.min(decimals, 12) }));
}

/** A text from elsewhere with true minus signs before its numbers. */
export function typeset(text: string): string {
  return text.replace(/(?<=^|\s)-(?=\d)/g, MINUS);
}

/** A whole number, grouped by thousands. */
export function integer(value: MaybeNumber): string {
  return isMissing(value) ? MISSING : signed(Math.round(value).toLocaleString('en-US'));
}

const SI: [number, string][] = [
  [1e9, 'G'],
  [1e6, 'M'],
  [1e3, 'k'],
  [1, ''],
  [1e-3, 'm'],
  [1e-6, 'µ'],
  [1e-9, 'n'],
];

/** A number with an SI prefix and its unit: 12.3 kHz, 7.04 µs. */
export function si(value: MaybeNumber, unit: string, digits = 3): string {
  if (isMissing(value)) return MISSING;
  if (value === 0) return withUnit('0', unit);
  const size = Math.abs(value);
  const [factor, prefix] = SI.find(([f]) => size >= f * 0.9995) ?? [1e-9, 'n'];
  return `${number(value / factor, digits)}${THIN}${prefix}${unit}`;
}

export function bytes(value: MaybeNumber): string {
  if (isMissing(value)) return MISSING;
  const units = ['B', 'KiB', 'MiB', 'GiB', 'TiB'];
  let power = 0;
  let rest = Math.abs(value);
  while (rest >= 1023.5 && power < units.length - 1) {
    rest /= 1024;
    power += 1;
  }
  return withUnit(number(Math.sign(value) * rest, 3), units[power] ?? 'B');
}

/** A share of one as percent. */
export function percent(value: MaybeNumber, digits = 3): string {
  return isMissing(value) ? MISSING : withUnit(number(value * 100, digits), '%');
}

/** How often something happens. Below one a second the prefix "milli" would read as metres. */
export function rate(perSecond: MaybeNumber): string {
  if (isMissing(perSecond)) return MISSING;
  return perSecond < 1 ? withUnit(number(perSecond, 2), '/s') : si(perSecond, '/s');
}

/** A probability as percent with one decimal, so that columns line up. */
export function probability(value: MaybeNumber): string {
  if (isMissing(value)) return MISSING;
  const tiny = value > 0 && value < 0.0005;
  return withUnit(tiny ? '<0.1' : (value * 100).toFixed(1), '%');
}

/** A number in a metric's own unit; shares become percent, bytes and seconds get readable sizes. */
export function quantity(value: MaybeNumber, unit: string, digits = 4): string {
  if (isMissing(value)) return MISSING;
  if (unit === 'share') return percent(value, digits);
  if (unit === 'bytes') return bytes(value);
  if (unit === 's') return duration(value);
  return withUnit(number(value, digits), unit);
}

function withUnit(text: string, unit: string): string {
  return unit ? `${text}${THIN}${unit}` : text;
}

/** Seconds as a length of time: 7 µs, 1.2 s, 3 min 05 s, 2 h 10 min, 4 d 3 h. */
export function duration(seconds: MaybeNumber): string {
  if (isMissing(seconds)) return MISSING;
  if (seconds < 0) return MINUS + duration(-seconds);
  if (seconds < 59.95) return si(seconds, 's');
  const whole = Math.round(seconds);
  const [minutes, hours, days] = [
    Math.floor(whole / 60),
    Math.floor(whole / 3600),
    Math.floor(whole / 86400),
  ];
  if (hours === 0) return two(minutes, 'min', whole % 60, 's');
  if (days === 0) return two(hours, 'h', minutes % 60, 'min');
  return two(days, 'd', hours % 24, 'h');
}

function two(major: number, majorUnit: string, minor: number, minorUnit: string): string {
  const head = `${major}${THIN}${majorUnit}`;
  return minor === 0 ? head : `${head} ${String(minor).padStart(2, '0')}${THIN}${minorUnit}`;
}

const AHEAD_S = 60; // of clocks of two machines, and of news on their way

/** How long ago, in one unit: "now", "12 s ago", "3 min ago", "5 d ago". */
export function age(unixS: MaybeNumber, nowUnixS: number): string {
  if (isMissing(unixS)) return MISSING;
  const seconds = nowUnixS - unixS;
  if (seconds < -AHEAD_S) return `in ${duration(-seconds)}`; // a clock that goes fast
  if (seconds < 1) return 'now';
  const steps: [number, string][] = [
    [86400, 'd'],
    [3600, 'h'],
    [60, 'min'],
    [1, 's'],
  ];
  const [size, unit] = steps.find(([step]) => seconds >= step) ?? [1, 's'];
  return `${Math.floor(seconds / size)}${THIN}${unit} ago`;
}

/** A point in time, for tooltips, in the reader's time zone. */
export function dateTime(unixS: MaybeNumber): string {
  if (isMissing(unixS)) return MISSING;
  return new Date(unixS * 1000).toLocaleString(undefined, {
    dateStyle: 'medium',
    timeStyle: 'medium',
  });
}

/** The time of day with milliseconds, in the reader's time zone. */
export function clockTime(unixS: number): string {
  const moment = new Date(unixS * 1000);
  return `${moment.toTimeString().slice(0, 8)}.${String(moment.getMilliseconds()).padStart(3, '0')}`;
}

/** Day and time of day, as lines of a log have them: "11-26 14:03:22.123". */
export function dayAndClock(unixS: number): string {
  const moment = new Date(unixS * 1000);
  const two = (n: number): string => String(n).padStart(2, '0');
  return `${two(moment.getMonth() + 1)}-${two(moment.getDate())} ${clockTime(unixS)}`;
}

/** The reader's time zone, in which all times are shown. */
export function timeZone(): string {
  const zone = new Intl.DateTimeFormat(undefined, { timeZoneName: 'short' })
    .formatToParts(new Date())
    .find((part) => part.type === 'timeZoneName')?.value;
  return zone ?? 'local time';
}

/** The end of a run's id: UUIDv7 begin alike when they were made together. */
export function shortId(id: string): string {
  return id.slice(-8);
}

/** A configuration value as text. */
export function configValue(value: unknown): string {
  if (value === null || value === undefined) return MISSING;
  if (typeof value === 'number') return Number.isInteger(value) ? String(value) : number(value, 6);
  return String(value);
}

export function plural(n: number, one: string, many = `${one}s`): string {
  return `${integer(n)} ${n === 1 ? one : many}`;
}
