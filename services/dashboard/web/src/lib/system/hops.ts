/** How long what flows is on its way, hop by hop. */

import type { Link, Node, Topology } from './topology';

export interface Hop {
  name: string;
  run: string | null;
  slot: number | null;
  count: number;
  p50Us: number;
  p95Us: number;
  p99Us: number;
  /** 0: one clock measured it. */
  uncertaintyUs: number;
}

/** In the order that a frame meets them; the whole loop is last. */
const OF_EDGES: { key: string; name: string; topic?: string }[] = [
  { key: 'camera_to_edge_us', name: 'camera → edge', topic: 'frame' },
  { key: 'inference_us', name: 'kernel' },
  { key: 'edge_us', name: 'edge, frame in to action out' },
  { key: 'action_to_robot_us', name: 'edge → robot', topic: 'action' },
  { key: 'camera_to_action_us', name: 'camera → action, all of it' },
];

/** All hops, by run and slot. Where two clocks are involved, what the link's estimate and its error say. */
export function hopsOf(topology: Topology): Hop[] {
  const edges = topology.nodes.filter((node) => node.kind === 'edge' && node.state !== 'dead');
  return edges.flatMap((edge) => {
    const links = topology.links.filter((link) => [link.source, link.target].includes(edge.id));
    const timed = OF_EDGES.flatMap(({ key, name, topic }) => {
      const link = links.find((one) => one.topic === topic && one.latency !== null);
      return link && uncertain(link) ? [ofLink(edge, link, name)] : ofNode(edge, key, name);
    });
    const weights = links.filter((link) => link.topic === 'weights' && link.latency !== null);
    return [...timed, ...weights.map((link) => ofLink(edge, link, 'weights, published → loaded'))];
  });
}

function uncertain(link: Link): boolean {
  return (link.latency?.uncertainty_us ?? 0) > 0;
}

function ofNode(edge: Node, key: string, name: string): Hop[] {
  const measured = edge.latencies[key];
  if (measured === undefined) return [];
  const { count, p50_us, p95_us, p99_us } = measured;
  const place = { run: edge.run, slot: edge.slot };
  return [{ name, ...place, count, p50Us: p50_us, p95Us: p95_us, p99Us: p99_us, uncertaintyUs: 0 }];
}

function ofLink(edge: Node, link: Link, name: string): Hop {
  const {
    count = 0,
    p50_us = NaN,
    p95_us = NaN,
    p99_us = NaN,
    uncertainty_us = 0,
  } = link.latency ?? {};
  const place = { run: edge.run, slot: edge.slot };
  return {
    name,
    ...place,
    count,
    p50Us: p50_us,
    p95Us: p95_us,
    p99Us: p99_us,
    uncertaintyUs: uncertainty_us,
  };
}
