/** The live hub's topics and what comes on them. */

export const topics = {
  camera: (run: string, slot: number) => `camera/${run}/${slot}`,
  actions: (run: string, slot: number) => `actions/${run}/${slot}`,
  metrics: (run: string) => `metrics/${run}`,
  logs: (run: string) => `logs/${run}`,
  runs: 'runs',
  alerts: 'alerts',
  topology: 'topology',
} as const;

/** What the policy of a slot chose and why. */
export interface Decision {
  iteration: number;
  episode: number;
  step: number;
  action: number;
  /** o, one integer per action; P = scale * o. */
  outputs: number[];
  scale: number;
  weights_version: number;
  inference_us: number;
  edge_us: number;
  time_unix_s: number;
}

export interface MetricPoint {
  name: string;
  step: number;
  value: number;
  time_unix_s: number;
}

export interface MetricPoints {
  points: MetricPoint[];
}

/** A run has changed, and the rest of its row comes by REST; or it is not there any more. */
export interface RunChange {
  id: string;
  rev?: number;
  removed?: boolean;
}
