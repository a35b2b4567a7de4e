/** A picture as marks on a plane in pixels, top left the origin: drawn on the page, written as SVG, PDF or PNG. */

export interface Style {
  stroke?: string; // "#rrggbb", as every colour here
  width?: number;
  dash?: readonly number[];
  fill?: string;
  alpha?: number; // of all of the mark
}

export interface PathMark extends Style {
  kind: 'path';
  points: readonly (readonly [number, number])[];
  closed?: boolean;
}

export interface CircleMark extends Style {
  kind: 'circle';
  x: number;
  y: number;
  r: number;
}

export type Anchor = 'start' | 'middle' | 'end';

export interface TextMark {
  kind: 'text';
  x: number;
  y: number; // of the baseline
  text: string;
  size: number;
  fill: string;
  anchor?: Anchor;
  bold?: boolean;
  /** Read from below: turned by a quarter to the left around its point. */
  upright?: boolean;
}

/** What a mark stands for, for readers of the page. */
export interface About {
  title?: string;
  href?: string;
  key?: string;
}

export type Mark = (PathMark | CircleMark | TextMark) & About;

export interface Drawing {
  width: number;
  height: number;
  background: string;
  marks: readonly Mark[];
}

/** The colours of a drawing that are not its data's. */
export interface Ink {
  text: string;
  muted: string;
  line: string;
  background: string;
}

export function line(
  points: readonly (readonly [number, number])[],
  stroke: string,
  width = 1,
  more: Partial<PathMark> & About = {},
): Mark {
  return { kind: 'path', points, stroke, width, ...more };
}

export function area(
  points: readonly (readonly [number, number])[],
  fill: string,
  alpha = 1,
  more: About = {},
): Mark {
  return { kind: 'path', points, closed: true, fill, alpha, ...more };
}

export function bar(
  x: number,
  y: number,
  width: number,
  height: number,
  fill: string,
  more: Partial<PathMark> & About = {},
): Mark {
  const [right, bottom] = [x + width, y + height];
  const points: [number, number][] = [
    [x, y],
    [right, y],
    [right, bottom],
    [x, bottom],
  ];
  return { kind: 'path', points, closed: true, fill, ...more };
}

export function label(
  x: number,
  y: number,
  text: string,
  fill: string,
  more: Partial<TextMark> & About = {},
): Mark {
  return { kind: 'text', x, y, text, fill, size: 12, ...more };
}

/** A drawing with a title above it, as it leaves the page. */
export function titled(drawing: Drawing, title: string, ink: Ink): Drawing {
  const roomPx = 28;
  const moved = drawing.marks.map((mark): Mark => {
    if (mark.kind === 'path')
      return { ...mark, points: mark.points.map(([x, y]) => [x, y + roomPx] as const) };
    return { ...mark, y: mark.y + roomPx };
  });
  return {
    ...drawing,
    height: drawing.height + roomPx,
    background: ink.background,
    marks: [label(12, 19, title, ink.text, { size: 13, bold: true }), ...moved],
  };
}
