/**
 * The clock of an episode's playback: frames, actions, rewards and preferences are all shown for the same
 * step, which is a pure function of this state and the time.
 */

export const SPEEDS = [0.25, 0.5, 1, 2, 4] as const;

export interface Playback {
  /** Frames: T + 1; the last one has no action. */
  readonly frames: number;
  /** Frame shown when the clock was last set; whole when paused. */
  readonly position: number;
  readonly playing: boolean;
  /** Factor on `framesPerSecond`. */
  readonly speed: number;
  readonly framesPerSecond: number;
}

export function newPlayback(frames: number, framesPerSecond: number): Playback {
  return { frames, position: 0, playing: false, speed: 1, framesPerSecond };
}

/** The frame to show, 0 .. frames - 1. */
export function currentFrame(playback: Playback): number {
  return Math.min(playback.frames - 1, Math.floor(playback.position));
}

/** Time goes on; playing stops at the last frame. */
export function advance(playback: Playback, elapsedS: number): Playback {
  if (!playback.playing) return playback;
  const position = playback.position + elapsedS * playback.framesPerSecond * playback.speed;
  const last = playback.frames - 1;
  return position >= last
    ? { ...playback, position: last, playing: false }
    : { ...playback, position };
}

/** Plays, from the start if it stood at the end; or pauses on the frame that is shown. */
export function toggle(playback: Playback): Playback {
  if (playback.playing) return { ...playback, playing: false, position: currentFrame(playback) };
  const atEnd = currentFrame(playback) === playback.frames - 1;
  return { ...playback, playing: playback.frames > 1, position: atEnd ? 0 : playback.position };
}

/** Shows a frame; goes on playing if it played. */
export function seek(playback: Playback, frame: number): Playback {
  const position = Math.max(0, Math.min(playback.frames - 1, Math.round(frame)));
  return { ...playback, position };
}

/** One frame on or back, paused. */
export function step(playback: Playback, by: number): Playback {
  return { ...seek(playback, currentFrame(playback) + by), playing: false };
}

/** The next or previous of `SPEEDS`. */
export function changeSpeed(playback: Playback, by: 1 | -1): Playback {
  const index = SPEEDS.findIndex((speed) => speed >= playback.speed);
  const speed = SPEEDS[Math.max(0, Math.min(SPEEDS.length - 1, index + by))]!;
  return { ...playback, speed };
}
