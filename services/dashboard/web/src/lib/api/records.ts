/** What is recorded about a run beside its metrics: artefacts, episodes, logs. */

import type { components } from '../../../generated/api';
import type { ApiClient } from './client';

type Schemas = components['schemas'];

export type Artefact = Schemas['Artefact'];
export type ArtefactKind = Artefact['kind'];
export type EpisodeList = Schemas['EpisodeList'];
/** T steps: there are T + 1 frames, and T of everything else. */
export type EpisodeDetail = Schemas['EpisodeSteps'];
export type LogRecord = Schemas['LogItem'];
export type LogPage = Schemas['LogPage'];

/** Frames of an episode, uint8[count, channels, height, width], each once. */
export interface EpisodeFrames {
  pixels: Uint8Array<ArrayBuffer>;
  count: number;
  channels: number;
  heightPx: number;
  widthPx: number;
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

  logs(query: LogQuery, signal?: AbortSignal): Promise<LogPage> {
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
