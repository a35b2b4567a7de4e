/** Curves as the server packs them: length of a JSON header, the header, then float32 columns of each curve. */

import { Problem } from './problem';
import type { Column, Series, SeriesAnswer } from './types';

export const SERIES_MEDIA_TYPE = 'application/vnd.bpn.series';
const COLUMNS = ['x', 'n', 'value', 'low', 'high', 'min', 'max', 'last'] as const;

type Described = Omit<Series, (typeof COLUMNS)[number]> & { length: number };

interface Header {
  series: Described[];
  columns: string[];
  seq: number;
  groups: number;
}

/** Unpacks curves; all numbers are little-endian. Throws a Problem if the message is cut or not of this form. */
export function decodeSeries(message: ArrayBuffer): SeriesAnswer {
  const header = readHeader(message);
  let at = 4 + headerLength(message);
  const series = header.series.map(({ length, ...described }) => {
    const columns = Object.fromEntries(
      header.columns.map((name) => {
        const column = readColumn(message, at, length);
        at += 4 * length;
        return [name, column];
      }),
    );
    return { ...described, ...columns } as Series;
  });
  if (at !== message.byteLength) throw unreadable(`${message.byteLength} bytes, not ${at}`);
  return { series, seq: header.seq, groups: header.groups };
}

function headerLength(message: ArrayBuffer): number {
  return message.byteLength < 4 ? 0 : new DataView(message).getUint32(0, true);
}

function readHeader(message: ArrayBuffer): Header {
  const length = headerLength(message);
  if (length === 0 || 4 + length > message.byteLength) throw unreadable('no header');
  try {
    const header = JSON.parse(new TextDecoder().decode(new Uint8Array(message, 4, length)));
    if (COLUMNS.every((name) => header.columns.includes(name))) return header;
  } catch {
    // falls through to the same complaint
  }
  throw unreadable('the header is not what this page reads');
}

function readColumn(message: ArrayBuffer, at: number, length: number): Column {
  if (at + 4 * length > message.byteLength) throw unreadable('cut off');
  const view = new DataView(message, at, 4 * length);
  return Array.from({ length }, (_, i) => {
    const value = view.getFloat32(4 * i, true);
    return Number.isNaN(value) ? null : value;
  });
}

function unreadable(why: string): Problem {
  return new Problem(-1, 'The curves could not be read', why);
}
