/** The REST interface as typed calls. Every failure is a `Problem`. */

import { Value } from '../observable';
import { count } from '../stats';
import { Problem, problemOf } from './problem';
import { decodeSeries, SERIES_MEDIA_TYPE } from './series';
import type * as t from './types';

type QueryValue = string | number | boolean | null | undefined;
type Query = Record<string, QueryValue>;

interface Options {
  query?: Query;
  body?: unknown;
  headers?: Record<string, string>;
  signal?: AbortSignal;
}

const DEADLINE_MS = 30_000;

export class ApiClient {
  /** False while the last call got no answer. */
  readonly reachable = new Value(true);
  /** Counts the answers that said that nobody is signed in. */
  readonly signedOut = new Value(0);

  /** @param base - URL of the interface, relative to the page so that any path prefix works. */
  constructor(private readonly base: string = new URL('api/v1', document.baseURI).href) {}

  async request(method: string, path: string, options: Options = {}): Promise<Response> {
    const url = `${this.base}${path}${queryString(options.query)}`;
    const headers: Record<string, string> = { Accept: 'application/json', ...options.headers };
    if (method !== 'GET') headers['X-Requested-With'] = 'bpn';
    if (options.body !== undefined) headers['Content-Type'] = 'application/json';
    const deadline = AbortSignal.timeout(DEADLINE_MS);
    const signal = options.signal ? AbortSignal.any([options.signal, deadline]) : deadline;
    const body = options.body === undefined ? null : JSON.stringify(options.body);
    let response: Response;
    count('requests');
    try {
      response = await fetch(url, { method, headers, body, signal, credentials: 'same-origin' });
    } catch (error) {
      if (options.signal?.aborted) throw error;
      this.reachable.set(false);
      const detail = deadline.aborted ? `no answer within ${DEADLINE_MS / 1000} s` : '';
      throw new Problem(0, 'The dashboard server does not answer', detail);
    }
    this.reachable.set(true);
    if (response.ok) return response;
    const problem = await problemOf(response);
    if (problem.signedOut && path !== '/session') this.signedOut.update((n) => n + 1);
    throw problem;
  }

  async json<T>(method: string, path: string, options?: Options): Promise<T> {
    const response = await this.request(method, path, options);
    return (response.status === 204 ? undefined : await response.json()) as T;
  }

  get<T>(path: string, query?: Query, signal?: AbortSignal): Promise<T> {
    return this.json<T>('GET', path, { query, signal } as Options);
  }

  post<T>(path: string, body?: unknown, headers?: Record<string, string>): Promise<T> {
    return this.json<T>('POST', path, { body, headers } as Options);
  }

  session = {
    get: () => this.get<t.Session>('/session'),
    open: (token: string) => this.post<void>('/session', { token }),
    close: () => this.json<void>('DELETE', '/session'),
  };

  runs = {
    page: (query: t.RunQuery, signal?: AbortSignal) =>
      this.get<t.RunPage>('/runs', runQuery(query), signal),
    get: (id: string, signal?: AbortSignal) => this.get<t.Run>(`/runs/${id}`, undefined, signal),
    create: (config: t.Config, about: { name?: string; notes?: string; tags?: string[] }) =>
      this.post<t.Run>('/runs', { config, ...about }, idempotency()),
    /** Changes name, notes or tags unless someone else did since `rev`. */
    update: (
      run: Pick<t.Run, 'id' | 'rev'>,
      changes: Partial<Pick<t.Run, 'name' | 'notes' | 'tags'>>,
    ) =>
      this.json<t.Run>('PATCH', `/runs/${run.id}`, {
        body: changes,
        headers: { 'If-Match': `"${run.rev}"` },
      }),
    act: (id: string, action: t.BulkAction) => this.post<t.Run>(`/runs/${id}/${action}`),
    bulk: (action: t.BulkAction, ids: string[]) =>
      this.post<{ results: t.BulkResult[] }>('/runs/bulk', { action, ids }),
    metrics: (id: string, signal?: AbortSignal) =>
      this.get<t.MetricNames>(`/runs/${id}/metrics`, undefined, signal),
    task: (id: string, signal?: AbortSignal) =>
      this.get<t.TaskInfo>(`/runs/${id}/task`, undefined, signal),
    configDiff: (id: string, other: string, signal?: AbortSignal) =>
      this.get<t.ConfigDiff>(`/runs/${id}/config-diff`, { other }, signal),
  };

  /** Of all runs that meet a filter, however many they are. */
  overview = (runs: t.RunQuery, signal?: AbortSignal) =>
    this.get<t.Overview>('/runs/overview', runQuery(runs), signal);

  runIds = (runs: t.RunQuery) => this.get<{ ids: string[] }>('/runs/ids', runQuery(runs));

  failures = (runs: t.RunQuery, signal?: AbortSignal) =>
    this.get<{ items: t.FailureReason[] }>('/runs/failures', runQuery(runs), signal);

  values = (
    subject: { runs?: string[]; filter?: Record<string, string | boolean> },
    columns: string[],
    signal?: AbortSignal,
  ) =>
    this.json<t.RunValues>('POST', '/runs/values', {
      body: { ...subject, columns },
      ...(signal ? { signal } : {}),
    });

  compare = (query: t.ComparisonQuery, signal?: AbortSignal) =>
    this.json<t.Comparison>('POST', '/comparison', {
      body: query,
      ...(signal ? { signal } : {}),
    });

  episodeDistributions = (query: unknown, signal?: AbortSignal) =>
    this.json<t.EpisodeDistributions>('POST', '/comparison/episodes', {
      body: query,
      ...(signal ? { signal } : {}),
    });

  tags = {
    all: (signal?: AbortSignal) => this.get<{ items: t.TagCount[] }>('/tags', undefined, signal),
    change: (ids: string[], add: string[], remove: string[]) =>
      this.post<{ changed: number }>('/runs/tags', { ids, add, remove }),
  };

  views = {
    all: (signal?: AbortSignal) => this.get<{ items: t.SavedView[] }>('/views', undefined, signal),
    save: (name: string, query: string) => this.post<t.SavedView>('/views', { name, query }),
    replace: ({ id, name }: t.SavedView, query: string) =>
      this.json<t.SavedView>('PUT', `/views/${id}`, { body: { name, query } }),
    delete: (id: string) => this.json<void>('DELETE', `/views/${id}`),
  };

  queue = {
    get: (signal?: AbortSignal) => this.get<t.Queue>('/queue', undefined, signal),
    move: (ids: string[], to: 'front' | 'back') => this.post<t.Queue>('/queue/move', { ids, to }),
  };

  /** What a run with this configuration would wait for; refused as creating it would be. */
  checkRun = (config: t.Config, signal?: AbortSignal) =>
    this.json<{ notices: string[] }>('POST', '/runs/check', {
      body: config,
      ...(signal ? { signal } : {}),
    });

  trash = {
    contents: (signal?: AbortSignal) =>
      this.get<{ items: t.RemovedRun[] }>('/trash', undefined, signal),
    /** The runs that a rule would move there. */
    outdated: (rule: { keep?: number; older_than_days?: number }) =>
      this.post<{ items: t.TidiedRun[] }>('/runs/prune', { ...rule, dry_run: true }),
    /** For good. */
    delete: (id: string) => this.json<void>('DELETE', `/trash/${id}`),
    /** For good. */
    empty: () => this.json<{ items: t.BulkResult[] }>('DELETE', '/trash'),
  };

  sweeps = {
    page: (query: { cursor?: string; limit?: number }, signal?: AbortSignal) =>
      this.get<t.SweepPage>('/sweeps', query, signal),
    get: (id: string, signal?: AbortSignal) =>
      this.get<t.Sweep>(`/sweeps/${id}`, undefined, signal),
    create: (sweep: Pick<t.Sweep, 'name' | 'config' | 'grid' | 'seeds'>) =>
      this.post<t.Sweep>('/sweeps', sweep, idempotency()),
    stop: (id: string) => this.post<t.Sweep>(`/sweeps/${id}/stop`),
  };

  configSchema = () => this.get<t.ConfigSchema>('/config-schema');

  heatmap = (
    query: { x: string; y: string; metric: string; value: t.HeatmapValue },
    runs: t.RunQuery,
    signal?: AbortSignal,
  ) => this.get<t.Heatmap>('/heatmap', { ...runQuery(runs), ...query }, signal);

  /** Curves as float32 columns: a quarter of the bytes and none of the parsing that JSON needs. */
  series = async (query: t.SeriesQuery, signal?: AbortSignal): Promise<t.SeriesAnswer> => {
    const headers = { Accept: SERIES_MEDIA_TYPE };
    const options = { body: query, headers, ...(signal ? { signal } : {}) };
    const response = await this.request('POST', '/series/query', options);
    return decodeSeries(await response.arrayBuffer());
  };
}

/** Filters of a run query as URL parameters; configuration keys get the prefix `config.`. */
export function runQuery({ config, ...rest }: t.RunQuery): Query {
  const pairs = Object.entries(config ?? {}).map(([key, value]) => [`config.${key}`, value]);
  return { ...rest, ...Object.fromEntries(pairs) };
}

function queryString(query: Query = {}): string {
  const parameters = new URLSearchParams();
  for (const [key, value] of Object.entries(query)) {
    if (value !== undefined && value !== null && value !== '') parameters.set(key, String(value));
  }
  const text = parameters.toString();
  return text && `?${text}`;
}

function idempotency(): Record<string, string> {
  return { 'Idempotency-Key': randomId() };
}

/** A random id; crypto.randomUUID exists only on https and localhost. */
export function randomId(): string {
  return Array.from(crypto.getRandomValues(new Uint8Array(16)), (byte) =>
    byte.toString(16).padStart(2, '0'),
  ).join('');
}
