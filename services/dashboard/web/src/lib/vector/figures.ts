/** The figures of a comparison as drawings: dots of seeds, profiles, distributions, scatter, parallel coordinates. */

import { number, quantity } from '../format';
import { axes, scaleOf, type Frame } from './axes';
import { area, bar, label, line, type Anchor, type Drawing, type Ink, type Mark } from './drawing';

export interface Interval {
  value: number | null;
  low: number | null;
  high: number | null;
}

export interface DotGroup {
  key: string;
  label: string;
  colour: string;
  scores: readonly { seed: number; score: number; href?: string }[];
  iqm: Interval;
}

const ROW_PX = 40;
const LEGEND_ROW_PX = 18;
const STROKE_PX = 26;
const LETTER_PX = 6.4; // of 12 px text, on average: only how much room a label gets depends on it

/** A row per group: a dot per seed, the interquartile mean as a stroke, its interval as a bar. */
export function dotsOf(
  groups: readonly DotGroup[],
  widthPx: number,
  ink: Ink,
  { unit = '', title = '', baseline = '' } = {},
): Drawing {
  const left = labelRoom(
    groups.map((one) => one.label),
    widthPx,
  );
  const bottom = 8 + ROW_PX * groups.length;
  const frame = { left, top: 8, right: widthPx - 16, bottom };
  const values = groups.flatMap(({ scores, iqm }) => [
    ...scores.map((one) => one.score),
    ...[iqm.low, iqm.high].filter((edge) => edge !== null),
  ]);
  const x = scaleOf(values, frame.left, frame.right);
  const marks: Mark[] = axes(frame, x, null, ink, { x: title });
  const pinned = groups.find((one) => one.key === baseline)?.iqm.value ?? null;
  if (pinned !== null && groups.length > 1)
    marks.push(line([[x(pinned), frame.top], [x(pinned), bottom]], ink.muted, 1, { dash: [3, 3] })); // prettier-ignore
  groups.forEach((group, i) => {
    const y = frame.top + ROW_PX * (i + 0.5);
    marks.push(
      label(left - 10, y + 4, clipped(group.label, left - 16), ink.text, {
        anchor: 'end',
        title: group.label,
      }),
    );
    const { value, low, high } = group.iqm;
    if (low !== null && high !== null)
      marks.push(
        bar(x(low), y - 6, Math.max(1, x(high) - x(low)), 12, group.colour, { alpha: 0.22 }),
      );
    group.scores.forEach(({ seed, score, href }, at) => {
      const shift = (((at * 7) % 5) - 2) * 3; // so that equal scores lie beside each other
      marks.push({
        kind: 'circle',
        x: x(score),
        y: y + shift,
        r: 4,
        fill: group.colour,
        stroke: ink.background,
        width: 1,
        title: `${group.label}, seed ${seed}: ${quantity(score, unit)}`,
        ...(href ? { href } : {}),
      });
    });
    if (value !== null)
      marks.push(
        line([[x(value), y - 13], [x(value), y + 13]], group.colour, 2.5, {
          title: `${group.label}: interquartile mean ${quantity(value, unit)}`,
        }),
      ); // prettier-ignore
  });
  return { width: widthPx, height: bottom + (title ? 42 : 24), background: ink.background, marks };
}

export interface ProfileLine {
  key: string;
  label: string;
  colour: string;
  dash: readonly number[];
  share: readonly number[];
  low: readonly (number | null)[];
  high: readonly (number | null)[];
}

/** The share of seeds above each score, with bands. */
export function profilesOf(
  thresholds: readonly number[],
  groups: readonly ProfileLine[],
  widthPx: number,
  heightPx: number,
  ink: Ink,
  title = '',
): Drawing {
  const frame = { left: 56, top: 10, right: widthPx - 12, bottom: heightPx - 42 };
  const x = scaleOf(thresholds, frame.left, frame.right, { room: 0 });
  const y = scaleOf([], frame.bottom, frame.top, { range: [0, 1.02] });
  const marks = axes(frame, x, y, ink, { x: title, y: 'share of seeds above' });
  for (const { low, high, colour } of groups) {
    const edges = (edge: readonly (number | null)[]): [number, number][] =>
      edge.flatMap((one, i): [number, number][] =>
        one === null ? [] : [[x(thresholds[i] ?? 0), y(one)]],
      );
    const band = [...edges(high), ...edges(low).reverse()];
    if (band.length > 2) marks.push(area(band, colour, 0.15));
  }
  for (const { share, colour, dash, label: title } of groups) {
    marks.push(
      line(share.map((one, i) => [x(thresholds[i] ?? 0), y(one)] as const), colour, 2, { dash, title }),
    ); // prettier-ignore
  }
  const legend = legendOf(groups, frame.left, heightPx + 8, frame.right, ink);
  marks.push(...legend.marks);
  return { width: widthPx, height: legend.bottom, background: ink.background, marks };
}

/** Strokes with what they stand for, in rows from a first baseline on: a saved picture has nothing beside it. */
function legendOf(
  lines: readonly Pick<ProfileLine, 'label' | 'colour' | 'dash'>[],
  left: number,
  top: number,
  right: number,
  ink: Ink,
): { marks: Mark[]; bottom: number } {
  const marks: Mark[] = [];
  let [x, y] = [left, top];
  for (const { label: text, colour, dash } of lines) {
    const room = Math.min(text.length * LETTER_PX, right - left - STROKE_PX);
    if (x > left && x + STROKE_PX + room > right) [x, y] = [left, y + LEGEND_ROW_PX];
    marks.push(
      line([[x, y - 4], [x + STROKE_PX - 6, y - 4]], colour, 2, { dash }),
      label(x + STROKE_PX, y, clipped(text, room + LETTER_PX), ink.text, { title: text }),
    ); // prettier-ignore
    x += STROKE_PX + room + 16;
  }
  return { marks, bottom: y + 10 };
}

export interface Histogram {
  key: string;
  label: string;
  colour: string;
  shares: readonly number[]; // of each bin
}

/** Distributions over the same bins, one above the other so that none hides another. */
export function distributionsOf(
  edges: readonly number[],
  groups: readonly Histogram[],
  widthPx: number,
  ink: Ink,
  title = '',
): Drawing {
  const rowPx = 64;
  const left = labelRoom(
    groups.map((one) => one.label),
    widthPx,
  );
  const bottom = 8 + rowPx * groups.length;
  const frame: Frame = { left, top: 8, right: widthPx - 16, bottom };
  const x = scaleOf(edges, frame.left, frame.right, { room: 0 });
  const highest = Math.max(...groups.flatMap((one) => one.shares), 1e-9);
  const marks = axes(frame, x, null, ink, { x: title });
  groups.forEach(({ label: name, colour, shares }, row) => {
    const base = frame.top + rowPx * (row + 1) - 4;
    marks.push(
      label(left - 10, base - rowPx / 2 + 8, clipped(name, left - 16), ink.text, {
        anchor: 'end',
        title: name,
      }),
      line([[frame.left, base], [frame.right, base]], ink.muted), // prettier-ignore
    );
    shares.forEach((share, i) => {
      const [low = 0, high = 0] = [edges[i], edges[i + 1]];
      const height = (share / highest) * (rowPx - 14);
      if (share > 0)
        marks.push(
          bar(x(low), base - height, Math.max(1, x(high) - x(low) - 1), height, colour, {
            alpha: 0.85,
            title: `${name}: ${number(share * 100, 3)} % of the episodes from ${number(low)} to ${number(high)}`,
          }),
        );
    });
  });
  return { width: widthPx, height: bottom + (title ? 42 : 24), background: ink.background, marks };
}

export interface Dot {
  x: number | string;
  y: number | string;
  colour: string;
  title: string;
  href: string;
}

/** An axis of numbers, or of texts in a row. */
export function axisOf(
  values: readonly (number | string)[],
  from: number,
  to: number,
): { at: (value: number | string) => number; ticks: { at: number; text: string }[] } {
  const texts = values.filter((value) => typeof value === 'string');
  if (texts.length === 0) {
    const scale = scaleOf(values as number[], from, to);
    return {
      at: (value) => scale(Number(value)),
      ticks: scale.ticks.map((tick) => ({ at: scale(tick), text: number(tick, 5) })),
    };
  }
  const names = [...new Set(values.map(String))].sort();
  const step = (to - from) / (names.length + 1);
  const at = (value: number | string): number => from + step * (names.indexOf(String(value)) + 1);
  return { at, ticks: names.map((text) => ({ at: at(text), text })) };
}

/** Runs over two columns of any kind. */
export function scatterOf(
  dots: readonly Dot[],
  widthPx: number,
  heightPx: number,
  ink: Ink,
  titles: { x: string; y: string },
): Drawing {
  const frame = { left: 84, top: 10, right: widthPx - 16, bottom: heightPx - 44 };
  const x = axisOf(dots.map((dot) => dot.x), frame.left, frame.right); // prettier-ignore
  const y = axisOf(dots.map((dot) => dot.y), frame.bottom, frame.top); // prettier-ignore
  const marks: Mark[] = [
    ...x.ticks.flatMap(({ at, text }): Mark[] => [
      line([[at, frame.top], [at, frame.bottom]], ink.line),
      label(at, frame.bottom + 16, clipped(text, 80), ink.muted, { anchor: 'middle', title: text }),
    ]),
    ...y.ticks.flatMap(({ at, text }): Mark[] => [
      line([[frame.left, at], [frame.right, at]], ink.line),
      label(frame.left - 6, at + 4, clipped(text, 56), ink.muted, { anchor: 'end', title: text }),
    ]),
    ...axes(frame, null, null, ink, titles),
  ]; // prettier-ignore
  for (const dot of dots) {
    const { colour: fill, title, href } = dot;
    marks.push({ kind: 'circle', x: x.at(dot.x), y: y.at(dot.y), r: 4, fill, alpha: 0.75, title, href });
  } // prettier-ignore
  return { width: widthPx, height: heightPx, background: ink.background, marks };
}

export interface ParallelRun {
  values: readonly (number | string | null)[]; // by axis
  colour: string;
  title: string;
  href: string;
  key: string;
}

/** Runs as lines through several columns. One without a value of a column stops there and goes on after it. */
export function parallelOf(
  titles: readonly string[],
  runs: readonly ParallelRun[],
  widthPx: number,
  heightPx: number,
  ink: Ink,
  chosen: string | null = null,
): Drawing {
  const frame = { left: 48, top: 34, right: widthPx - 48, bottom: heightPx - 12 };
  const step = (frame.right - frame.left) / Math.max(1, titles.length - 1);
  const marks: Mark[] = [];
  const columns = titles.map((title, i) => {
    const x = titles.length > 1 ? frame.left + step * i : (frame.left + frame.right) / 2;
    const values = runs.map((run) => run.values[i] ?? null).filter((value) => value !== null);
    const axis = axisOf(values, frame.bottom, frame.top);
    marks.push(
      line([[x, frame.top], [x, frame.bottom]], ink.muted),
      label(x, 16, clipped(title, Math.max(step, 90) - 8), ink.text, { anchor: titles.length === 1 ? 'middle' : anchors(i, titles.length), bold: true, title }),
    ); // prettier-ignore
    return { x, axis };
  });
  for (const run of runs) {
    const faint = chosen !== null && run.key !== chosen;
    const style = {
      alpha: faint ? 0.12 : 0.7,
      title: run.title,
      href: run.href,
      key: run.key,
    };
    for (const points of pieces(
      columns.map(({ x, axis }, i) => {
        const value = run.values[i] ?? null;
        return value === null ? null : ([x, axis.at(value)] as const);
      }),
    ))
      marks.push(line(points, run.colour, run.key === chosen ? 3 : 1.5, style));
  }
  for (const { x, axis } of columns)
    for (const { at, text } of axis.ticks)
      marks.push(
        label(x + 5, at + 4, clipped(text, step - 10), ink.muted, { size: 11, title: text }),
      );
  return { width: widthPx, height: heightPx, background: ink.background, marks };
}

/** Titles at the ends stay inside. */
function anchors(i: number, n: number): Anchor {
  return i === 0 ? 'start' : i === n - 1 ? 'end' : 'middle';
}

/** Runs of points without a hole; a single one is drawn as a short stroke. */
function pieces(
  points: readonly (readonly [number, number] | null)[],
): (readonly [number, number])[][] {
  const found: (readonly [number, number])[][] = [[]];
  for (const point of points) {
    if (point) found.at(-1)?.push(point);
    else found.push([]);
  }
  return found
    .filter((piece) => piece.length > 0)
    .map((piece) => {
      const [only] = piece;
      return piece.length === 1 && only ? [[only[0] - 5, only[1]], [only[0] + 5, only[1]]] : piece;
    }); // prettier-ignore
}

function labelRoom(labels: readonly string[], widthPx: number): number {
  const longest = Math.max(...labels.map((one) => one.length), 4) * LETTER_PX + 24;
  return Math.min(longest, Math.max(90, widthPx * 0.38));
}

function clipped(text: string, roomPx: number): string {
  const most = Math.max(3, Math.floor(roomPx / LETTER_PX));
  return text.length > most ? `${text.slice(0, most - 1)}…` : text;
}
