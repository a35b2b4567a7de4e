/** Who is alive, what each does, and what flows between them, as the live hub tells it once a second. */

export interface Percentiles {
  count: number;
  p50_us: number;
  p95_us: number;
  p99_us: number;
  max_us: number;
}

export interface WeightsMark {
  attempt: number;
  version: number;
  time_unix_s: number;
}

export interface Flow {
  key: string;
  direction: 'sent' | 'received';
  messages: number;
  bytes: number;
  dropped: number;
  messages_per_s: number;
  bytes_per_s: number;
  dropped_per_s: number;
}

export type NodeState = 'live' | 'stale' | 'dead';

export interface Node {
  kind: string;
  id: string;
  state: NodeState;
  /** Since its last report; null before the first. */
  age_s: number | null;
  run: string | null;
  slot: number | null;
  host: string;
  pid: number | null;
  uptime_s: number | null;
  waiting_for: string | null;
  waiting_s: number;
  cpu_percent: number | null;
  rss_bytes: number | null;
  counters: Record<string, number>;
  /** Of its program; empty of one that did not tell. */
  version?: string;
  protocol?: number | null;
  weights: Partial<Record<'published' | 'loaded' | 'running', WeightsMark>>;
  latencies: Record<string, Percentiles>;
  flows: Flow[];
}

export interface Link {
  source: string;
  target: string;
  topic: string;
  form: 'stream' | 'request';
  key: string;
  run: string | null;
  messages: number;
  messages_per_s: number;
  bytes_per_s: number;
  dropped: number;
  dropped_per_s: number;
  latency: {
    count: number;
    p50_us: number;
    p95_us: number;
    p99_us: number;
    uncertainty_us: number;
  } | null;
}

export interface Topology {
  time_unix_s: number;
  nodes: Node[];
  links: Link[];
}

/** What is counted as dropped. */
export const DROPPED =
  'pictures and states that a newer one replaced before they were read, and requests without an answer in time';

const KINDS: Record<string, string> = {
  robot_sim: 'Robot',
  edge: 'Edge',
  learner: 'Learner',
  dashboard: 'Dashboard',
};

/** "Edge 0", "Learner", or the kind as it is. */
export function nodeName(node: Pick<Node, 'kind' | 'slot' | 'run'>): string {
  const kind = KINDS[node.kind] ?? node.kind;
  const numbered = node.run !== null && node.slot !== null && node.kind !== 'learner';
  return numbered ? `${kind} ${node.slot}` : kind;
}

/** The version that a service runs (an edge) or published last (a learner). */
export function weightsVersion(node: Node): number | null {
  return (node.weights.running ?? node.weights.loaded ?? node.weights.published)?.version ?? null;
}

/** Messages a second that a service sends and receives, and what it dropped in all. */
export function traffic(node: Node): { sent: number; received: number; dropped: number } {
  const sum = (direction: Flow['direction']) =>
    node.flows
      .filter((flow) => flow.direction === direction)
      .reduce((total, flow) => total + flow.messages_per_s, 0);
  const dropped = node.flows.reduce((total, flow) => total + flow.dropped, 0);
  return { sent: sum('sent'), received: sum('received'), dropped };
}
