/** uPlot behind our own interface: the only module that knows it. Colours follow the theme, zoom outlives new data. */

import uPlot from 'uplot';
import 'uplot/dist/uPlot.min.css';
import type { Column } from '../api/types';
import { PALETTE, withAlpha, type ThemeName } from '../colour';
import { bytes, duration, number } from '../format';
import { count } from '../stats';
import type { Drawing, Ink } from '../vector/drawing';
import { alone } from './gaps';
import { drawMarks, type Mark } from './marks';
import { picture } from './picture';
import { planOf, shapeOf, type Line, type Part, type Plan } from './plan';
import { widened, type Range } from './range';
import { vectorOf } from './vector';
import { distributionOf, linearUpTo, yRange, type Distribution, type YScale } from './scale';

export type { Range };

export interface PlotState {
  lines: readonly Line[];
  hidden: ReadonlySet<string>;
  smoothing: number;
  range: Range | null; // x that is shown; null: all
  yScale: YScale;
  marks: readonly Mark[];
  unit: string;
  xName: string;
  xUnit: string; // 's': a time; '': x counts something, without fractions at its axis
  theme: ThemeName;
  heightPx: number;
}

export interface PlotEvents {
  /** The index of x under the cursor; null: the cursor is elsewhere. */
  cursor(index: number | null): void;
  /** The user chose a range of x, or all. */
  range(range: Range | null): void;
  /** What was last given is drawn. */
  drawn(): void;
}

const WHOLE_STEPS = Array.from({ length: 10 }, (_, power) =>
  [1, 2, 5].map((step) => step * 10 ** power),
).flat();
const TIME_STEPS = [1, 60, 3600, 86_400].flatMap((unit) =>
  (unit === 1 || unit === 60 ? [1, 2, 5, 10, 15, 30] : [1, 2, 3, 6, 12, 24, 48, 120, 240]).map(
    (step) => step * unit,
  ),
);
const SMALL_STEPS = [1e-3, 1e-2, 0.1].flatMap((size) => [1, 2, 5].map((step) => step * size));
const RAW_ALPHA = 0.28;
const BAND_ALPHA = 0.18;
const MANY_BANDS = 3; // from there on they are fainter, so that lines stay in front
const FOCUS_PX = 24;

export class Plot {
  #chart: uPlot | null = null;
  #plan: Plan = planOf([], 0);
  #state: PlotState | null = null;
  #shape = '';
  readonly #sizes: ResizeObserver;

  constructor(
    private readonly element: HTMLElement,
    private readonly events: PlotEvents,
    private readonly sync: string | null,
  ) {
    this.#sizes = new ResizeObserver(() => this.#resize());
    this.#sizes.observe(element);
  }

  get plan(): Plan {
    return this.#plan;
  }

  update(state: PlotState): void {
    const before = this.#state;
    if (before?.lines !== state.lines || before.smoothing !== state.smoothing) {
      this.#plan = planOf(state.lines, state.smoothing);
    }
    this.#state = state;
    const distribution = distributionOf(state.yScale, this.#values());
    const shape = `${shapeOf(state.lines, state.smoothing)} ${distribution} ${state.xUnit}`;
    if (!this.#chart || shape !== this.#shape) {
      this.#shape = shape;
      this.#rebuild(distribution);
      return;
    }
    const chart = this.#chart;
    chart.batch(() => {
      // Anew where y is shown otherwise, too: its range is computed with the data's.
      if (chart.data !== this.#plan.columns || before?.yScale !== state.yScale)
        chart.setData(this.#plan.columns as uPlot.AlignedData, true);
      else {
        const [min, max] = this.#range();
        chart.setScale('x', { min, max });
      }
      this.#plan.series.forEach(({ line }, i) => {
        const show = !state.hidden.has(state.lines[line]?.key ?? '');
        if (chart.series[i + 1]?.show !== show) chart.setSeries(i + 1, { show });
      });
    });
    if (before?.theme !== state.theme || before.marks !== state.marks) chart.redraw(false, true);
    if (before?.heightPx !== state.heightPx) this.#resize();
  }

  /** Moves the cursor to an index of x, for the keyboard. */
  pointAt(index: number): void {
    const chart = this.#chart;
    const x = chart?.data[0][index];
    if (!chart || x === undefined) return;
    chart.setCursor({ left: chart.valToPos(x, 'x'), top: chart.over.clientHeight / 2 });
  }

  /** What is drawn, as an image with title and legend; null if nothing is. */
  png(title: string): Promise<Blob | null> {
    const { lines, hidden } = this.#state ?? { lines: [], hidden: new Set<string>() };
    if (!this.#chart) return Promise.resolve(null);
    const entries = lines.map(({ label, key }, i) => ({ label, key, colour: this.#colour(i) }));
    return picture(this.#chart.ctx.canvas, {
      title,
      entries: entries.filter(({ key }) => !hidden.has(key)),
      background: this.#token('--surface'),
      text: this.#token('--text'),
      font: this.#token('--font'),
    });
  }

  /** What is drawn, as vectors; null if nothing is. */
  drawing(ink: Ink): Drawing | null {
    const [chart, state] = [this.#chart, this.#state];
    if (!chart || !state) return null;
    const left = chart.over.offsetLeft;
    const top = chart.over.offsetTop;
    const scale = (key: 'x' | 'y', shift: number, text: (value: number) => string) => ({
      low: chart.scales[key]?.min ?? 0,
      high: chart.scales[key]?.max ?? 1,
      at: (value: number) => shift + chart.valToPos(value, key),
      text,
    });
    return vectorOf(
      {
        widthPx: chart.width,
        heightPx: chart.height,
        frame: {
          left,
          top,
          right: left + chart.over.clientWidth,
          bottom: top + chart.over.clientHeight,
        },
        x: scale('x', left, (value) => (state.xUnit === 's' ? duration(value) : number(value, 6))),
        y: scale('y', top, (value) => this.#tick(value)),
        distribution: distributionOf(state.yScale, this.#values()),
        plan: this.#plan,
        lines: state.lines,
        hidden: state.hidden,
        colour: (line) => this.#colour(line),
        bandAlpha: this.#bandAlpha(),
        rawAlpha: RAW_ALPHA,
      },
      ink,
    );
  }

  destroy(): void {
    this.#sizes.disconnect();
    this.#chart?.destroy();
    this.#chart = null;
  }

  /** What is drawn of y. */
  #values(): readonly Column[] {
    return this.#plan.columns.slice(1).map((column) => column.map((value) => value ?? null));
  }

  #rebuild(distribution: Distribution): void {
    this.#chart?.destroy();
    const options = this.#options(distribution);
    this.#chart = new uPlot(options, this.#plan.columns as uPlot.AlignedData, this.element);
  }

  #resize(): void {
    const width = this.element.clientWidth;
    const height = this.#state?.heightPx ?? 0;
    if (
      this.#chart &&
      width > 0 &&
      (width !== this.#chart.width || height !== this.#chart.height)
    ) {
      this.#chart.setSize({ width, height });
    }
  }

  /** The x that is shown. */
  #range(): Range {
    const xs = this.#plan.columns[0] ?? [];
    return this.#state?.range ?? widened(xs[0] ?? null, xs[xs.length - 1] ?? null);
  }

  #colour(line: number): string {
    const { lines, theme } = this.#state ?? { lines: [], theme: 'light' as ThemeName };
    return PALETTE[theme][lines[line]?.stroke.colour ?? 0] ?? '#888888';
  }

  #bandAlpha(): number {
    return BAND_ALPHA * Math.min(1, MANY_BANDS / this.#plan.bands.length);
  }

  /** A value at the y axis; shares are written as percent, as in the title. */
  #tick(value: number | null): string {
    if (value === null) return '';
    if (this.#state?.unit === 'bytes') return bytes(value);
    return number(this.#state?.unit === 'share' ? value * 100 : value, 5);
  }

  #token(name: string): string {
    return getComputedStyle(this.element).getPropertyValue(name).trim();
  }

  /** What is written at places of x. */
  #xTicks(ticks: readonly number[]): string[] {
    const time = this.#state?.xUnit === 's';
    return ticks.map((tick) => (time && tick !== 0 ? duration(tick) : number(tick, 6)));
  }

  #yScaleOptions(distribution: Distribution): uPlot.Scale {
    const range: uPlot.Range.Function = (_chart, low, high) => {
      const scale = this.#state?.yScale ?? { logarithmic: false, clipped: false, range: null };
      return yRange(scale, this.#values(), low, high);
    };
    if (distribution === 'linear') return { distr: 1, range };
    const chosen = this.#state?.yScale.range;
    const fixed = chosen ? { range: (): uPlot.Range.MinMax => [...chosen] } : {};
    if (distribution === 'log') return { distr: 3, ...fixed };
    return { distr: 4, asinh: linearUpTo(this.#values()), ...fixed };
  }

  #drawMarks(chart: uPlot): void {
    const style = {
      colour: this.#token('--muted'),
      font: `${11 * uPlot.pxRatio}px ${this.#token('--font') || 'sans-serif'}`,
      scale: uPlot.pxRatio,
    };
    const at = (x: number): number => chart.valToPos(x, 'x', true);
    drawMarks(chart.ctx, this.#state?.marks ?? [], at, chart.bbox, style);
  }

  #options(distribution: Distribution): uPlot.Options {
    const state = this.#state;
    const { events } = this;
    const axis: uPlot.Axis = {
      stroke: () => this.#token('--muted'),
      grid: { stroke: () => this.#token('--line'), width: 1 },
      ticks: { show: false },
      font: `12px ${this.#token('--font') || 'sans-serif'}`,
      gap: 6,
    };
    return {
      width: Math.max(this.element.clientWidth, 100),
      height: state?.heightPx ?? 200,
      legend: { show: false },
      padding: [10, 12, 0, 0],
      scales: {
        x: { time: false, range: () => this.#range() },
        y: this.#yScaleOptions(distribution),
      },
      axes: [
        {
          ...axis,
          size: 28,
          space: state?.xUnit === 's' ? 84 : 64,
          label: () => this.#state?.xName ?? '',
          labelSize: 16,
          labelGap: -2,
          labelFont: `11px ${this.#token('--font') || 'sans-serif'}`,
          ...(state?.xUnit === '' ? { incrs: WHOLE_STEPS } : {}),
          ...(state?.xUnit === 's'
            ? {
                incrs: [
                  ...SMALL_STEPS,
                  ...TIME_STEPS,
                  ...WHOLE_STEPS.map((step) => step * 864_000),
                ],
              }
            : {}),
          values: (_chart, ticks) => this.#xTicks(ticks),
        },
        {
          ...axis,
          size: (_chart, labels) =>
            14 + 7 * Math.max(3, ...(labels ?? []).map((label) => label?.length ?? 0)),
          values: (_chart, ticks) => ticks.map((tick) => this.#tick(tick)),
        },
      ],
      series: [{}, ...this.#plan.series.map(({ line, part }) => this.#series(line, part))],
      bands: this.#plan.bands.map(({ series, line }) => ({
        series,
        fill: () => withAlpha(this.#colour(line), this.#bandAlpha()),
      })),
      focus: { alpha: 0.35 },
      cursor: {
        y: false,
        drag: { x: true, y: false, setScale: false, dist: 4 },
        focus: { prox: FOCUS_PX },
        points: { size: 7 },
        bind: { dblclick: () => () => (events.range(null), null) },
        ...(this.sync ? { sync: { key: this.sync, setSeries: false } } : {}),
      },
      hooks: {
        setCursor: [(chart) => events.cursor(chart.cursor.idx ?? null)],
        setSelect: [(chart) => this.#selected(chart)],
        draw: [
          (chart) => {
            this.#drawMarks(chart);
            count('charts drawn');
            events.drawn();
          },
        ],
      },
    };
  }

  #series(line: number, part: Part): uPlot.Series {
    const { lines, hidden } = this.#state ?? { lines: [] as Line[], hidden: new Set<string>() };
    const edge = part === 'low' || part === 'high';
    const one = lines[line];
    return {
      label: one?.label ?? '',
      show: !hidden.has(one?.key ?? ''),
      stroke: edge
        ? 'transparent'
        : () => (part === 'raw' ? withAlpha(this.#colour(line), RAW_ALPHA) : this.#colour(line)),
      width: part === 'raw' ? 1 : edge ? 0 : 2,
      dash: part === 'value' ? [...(one?.stroke.dash ?? [])] : [],
      points:
        part === 'value'
          ? { show: true, size: 5, filter: (chart, at) => alone(chart.data[at] ?? []) }
          : { show: false },
    };
  }

  #selected(chart: uPlot): void {
    const { left, width } = chart.select;
    if (width <= 0) return;
    chart.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
    this.events.range([chart.posToVal(left, 'x'), chart.posToVal(left + width, 'x')]);
  }
}
