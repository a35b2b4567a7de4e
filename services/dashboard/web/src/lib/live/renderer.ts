/**
 * Draws frames when the browser draws: of the frames that came since the last animation frame only the
 * newest is decoded, and every one is acknowledged, so that the hub sends as many as can be seen.
 */

import { RateMeter } from './meter';
import { frameToRgba } from './pixels';
import type { Frame } from './protocol';

export interface Painted {
  seq: number;
  captureUnixS: number;
  framesPerSecond: number;
}

export class FrameRenderer {
  drawn = 0;
  skipped = 0;
  private next: { frame: Frame; done: () => void } | null = null;
  private request = 0;
  private readonly meter = new RateMeter();

  /**
   * @param canvases one per stacked frame, newest first; frames without a canvas are not drawn.
   */
  constructor(
    private readonly canvases: () => readonly (HTMLCanvasElement | undefined)[],
    private readonly onPainted: (painted: Painted) => void = () => undefined,
  ) {}

  offer(frame: Frame, done: () => void): void {
    if (this.next !== null) {
      this.skipped += 1;
      this.next.done();
    }
    this.next = { frame, done };
    if (this.request === 0) this.request = requestAnimationFrame((nowMs) => this.paint(nowMs));
  }

  stop(): void {
    cancelAnimationFrame(this.request);
    this.request = 0;
    this.next?.done();
    this.next = null;
  }

  private paint(nowMs: number): void {
    this.request = 0;
    if (this.next === null) return;
    const { frame, done } = this.next;
    this.next = null;
    this.canvases()
      .slice(0, frame.framesStacked)
      .forEach((canvas, back) => canvas && drawFrame(canvas, frame, back));
    done();
    this.drawn += 1;
    this.meter.add(nowMs);
    this.onPainted({
      seq: frame.seq,
      captureUnixS: frame.captureUnixS,
      framesPerSecond: this.meter.perSecond(nowMs),
    });
  }
}

/** Draws the `back`-th newest frame of a stack in its own resolution; CSS enlarges it. */
export function drawFrame(
  canvas: HTMLCanvasElement,
  stack: Parameters<typeof frameToRgba>[0],
  back: number,
): void {
  const { widthPx, heightPx } = stack;
  if (canvas.width !== widthPx || canvas.height !== heightPx) {
    canvas.width = widthPx;
    canvas.height = heightPx;
  }
  canvas
    .getContext('2d')
    ?.putImageData(new ImageData(frameToRgba(stack, back), widthPx, heightPx), 0, 0);
}
