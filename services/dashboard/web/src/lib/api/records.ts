/** What is recorded about a run beside its metrics: artefacts, episodes, logs. */

import type { ApiClient } from './client';

export type ArtefactKind = 'weights' | 'checkpoint' | 'config' | 'metrics' | 'log' | 'onnx';

export interface Artefact {
  id: string;
  kind: ArtefactKind;
  name: string;
  version: number | null;
  size_bytes: number;
  sha256: string;
  created_at_unix_s: number;
}

export interface EpisodeRow {
  iteration: number;
  episode: number;
  steps: number;
  return_px: number | null;
  weights_version: number;
  slot: number;
  worker: string;
}

/** One iteration's episodes, and which iterations have any. */
export interface EpisodeList {
  iteration: number | null;
  first_iteration: number | null;
  last_iteration: number | null;
  items: EpisodeRow[];
}

export interface EpisodeDetail {
  /** T: there are T + 1 frames, and T of everything else. */
  steps: number;
  actions: number[];
  action_names: string[];
  outputs: number[][];
  preferences: number[][];
  rewards_px: number[] | null;
  weights_version: number;
  scale: number;
  /** Null where no action came in time. */
  camera_to_action_us: (number | null)[];
  inference_us: number[];
}

/** Frames of an episode, uint8[count, channels, height, width], each once. */
export interface EpisodeFrames {
  pixels: Uint8Array<ArrayBuffer>;
  count: number;
  channels: number;
  heightPx: number;
  widthPx: number;
}

export interface LogRecord {
  id: string;
  time_unix_s: number | null;
  level: string;
  service: string;
  message: string;
}

export interface LogQuery {
  service?: string;
  level?: string;
  search?: string;
  cursor?: string;
  limit?: number;
}

/** The calls for one run. */
export class RunRecords {
  constructor(
    private readonly api: ApiClient,
    private readonly run: string,
  ) {}

  artefacts(signal?: AbortSignal): Promise<{ items: Artefact[] }> {
    return this.api.get(`/runs/${this.run}/artefacts`, undefined, signal);
  }

  /** Of an iteration; null: of the newest that has episodes. */
  episodes(iteration: number | null, signal?: AbortSignal): Promise<EpisodeList> {
    return this.api.get(`/runs/${this.run}/episodes`, { iteration }, signal);
  }

  episode(iteration: number, episode: number, signal?: AbortSignal): Promise<EpisodeDetail> {
    return this.api.get(`/runs/${this.run}/episodes/${iteration}/${episode}`, undefined, signal);
  }

  async frames(iteration: number, episode: number, signal: AbortSignal): Promise<EpisodeFrames> {
    const path = `/runs/${this.run}/episodes/${iteration}/${episode}/frames`;
    const response = await this.api.request('GET', path, {
      headers: { Accept: 'application/octet-stream' },
      signal,
    });
    return readFrames(response.headers.get('X-Frames-Shape') ?? '', await response.arrayBuffer());
  }

  logs(
    query: LogQuery,
    signal?: AbortSignal,
  ): Promise<{ items: LogRecord[]; next_cursor: string | null }> {
    return this.api.get(`/runs/${this.run}/logs`, { ...query }, signal);
  }
}

/** Frames with their shape as the header says it, "21,1,84,84". Throws RangeError if the bytes do not fit it. */
export function readFrames(shape: string, data: ArrayBuffer): EpisodeFrames {
  const sizes = shape.split(/[\s,x]+/).map(Number);
  const [count = 0, channels = 0, heightPx = 0, widthPx = 0] = sizes;
  if (sizes.length !== 4 || data.byteLength !== count * channels * heightPx * widthPx) {
    throw new RangeError(`${data.byteLength} bytes of frames do not have the shape "${shape}"`);
  }
  return { pixels: new Uint8Array(data), count, channels, heightPx, widthPx };
}
