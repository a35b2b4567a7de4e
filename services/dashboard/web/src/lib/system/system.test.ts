import { expect, test } from 'vitest';
import { hopsOf } from './hops';
import { BOX, layout } from './layout';
import { nodeName, traffic, weightsVersion, type Link, type Node } from './topology';

function node(
  kind: string,
  slot: number | null,
  run: string | null = 'r1',
  more: Partial<Node> = {},
): Node {
  return {
    kind,
    id: `${kind}-${run}-${slot}`,
    state: 'live',
    age_s: 0.2,
    run,
    slot,
    host: 'here',
    pid: 1,
    uptime_s: 5,
    waiting_for: null,
    waiting_s: 0,
    cpu_percent: 10,
    rss_bytes: 1,
    counters: {},
    weights: {},
    latencies: {},
    flows: [],
    ...more,
  };
}

function link(topic: string, source: Node, target: Node): Link {
  return {
    source: source.id,
    target: target.id,
    topic,
    form: 'stream',
    key: topic,
    run: source.run,
    messages: 1,
    messages_per_s: 1,
    bytes_per_s: 1,
    dropped: 0,
    dropped_per_s: 0,
    latency: null,
  };
}

const learner = node('learner', 0);
const edges = [node('edge', 0), node('edge', 1)];
const robots = [node('robot_sim', 0), node('robot_sim', 1)];
const idle = node('edge', null, null);
const everything = {
  time_unix_s: 0,
  nodes: [idle, learner, ...edges, ...robots, node('dashboard', null, null)],
  links: [
    ...robots.map((robot, i) => link('frame', robot, edges[i]!)),
    ...edges.map((edge, i) => link('action', edge, robots[i]!)),
    link('weights', learner, edges[0]!),
    link('next', edges[0]!, learner),
    link('frame', robots[0]!, node('edge', 9, 'elsewhere')),
  ],
};

test('boxes stand in columns by kind and never overlap', () => {
  const { boxes, width, height } = layout(everything);
  expect(boxes).toHaveLength(6); // all but the dashboard
  const column = (kind: string) =>
    new Set(boxes.filter((b) => b.node.kind === kind).map((b) => b.x));
  expect([...column('robot_sim'), ...column('edge'), ...column('learner')]).toHaveLength(3);
  for (const one of boxes) {
    expect(one.x + BOX.width).toBeLessThanOrEqual(width);
    expect(one.y + BOX.height).toBeLessThanOrEqual(height);
    for (const other of boxes) {
      if (one !== other && one.x === other.x) {
        expect(Math.abs(one.y - other.y)).toBeGreaterThanOrEqual(BOX.height);
      }
    }
  }
});

test('a run is one group with its slots in rows, idle workers are the last group', () => {
  const { groups, boxes } = layout(everything);
  expect(groups.map((group) => group.run)).toEqual(['r1', null]);
  const y = (wanted: Node) => boxes.find((box) => box.node === wanted)!.y;
  expect(y(robots[0]!)).toBe(y(edges[0]!));
  expect(y(robots[1]!)).toBe(y(edges[1]!));
  expect(y(learner)).toBe((y(edges[0]!) + y(edges[1]!)) / 2);
  expect(y(idle)).toBeGreaterThan(groups[1]!.y);
});

test('what is drawn flows between boxes that are there; asking for work is not drawn', () => {
  const topics = layout(everything).arrows.map(({ link }) => link.topic);
  expect(topics).toEqual(['frame', 'frame', 'action', 'action', 'weights']);
});

test('nothing makes an empty picture', () => {
  expect(layout({ time_unix_s: 0, nodes: [], links: [] })).toMatchObject({ boxes: [], height: 0 });
});

test('names, versions and rates of a service', () => {
  expect(nodeName(edges[1]!)).toBe('Edge 1');
  expect(nodeName(learner)).toBe('Learner');
  expect(nodeName(idle)).toBe('Edge');
  const mark = (version: number) => ({ attempt: 1, version, time_unix_s: 0 });
  expect(
    weightsVersion(node('edge', 0, 'r', { weights: { loaded: mark(4), running: mark(3) } })),
  ).toBe(3);
  expect(weightsVersion(node('learner', 0, 'r', { weights: { published: mark(5) } }))).toBe(5);
  expect(weightsVersion(idle)).toBeNull();
  const flow = (direction: 'sent' | 'received', messages_per_s: number, dropped: number) => ({
    key: 'k',
    direction,
    messages: 0,
    bytes: 0,
    dropped,
    messages_per_s,
    bytes_per_s: 0,
    dropped_per_s: 0,
  });
  const flows = [flow('sent', 3, 0), flow('sent', 4, 1), flow('received', 5, 2)];
  expect(traffic(node('edge', 0, 'r', { flows }))).toEqual({ sent: 7, received: 5, dropped: 3 });
});

test('hops are measured by the edge, or estimated from the link where two clocks are involved', () => {
  const measured = { count: 9, p50_us: 100, p95_us: 200, p99_us: 300, max_us: 400 };
  const latencies = { camera_to_edge_us: measured, inference_us: measured };
  const edge = node('edge', 0, 'r1', { latencies });
  const estimate = { count: 9, p50_us: 5000, p95_us: 5500, p99_us: 6000, uncertainty_us: 5000 };
  const there = { time_unix_s: 0, nodes: [edge], links: [link('frame', robots[0]!, edge)] };
  expect(hopsOf(there).map((hop) => [hop.name, hop.p50Us, hop.uncertaintyUs])).toEqual([
    ['camera → edge', 100, 0],
    ['kernel', 100, 0],
  ]);
  const links = [
    { ...link('frame', robots[0]!, edge), latency: estimate },
    { ...link('weights', learner, edge), latency: { ...estimate, uncertainty_us: 0 } },
  ];
  expect(
    hopsOf({ ...there, links }).map((hop) => [hop.name, hop.p50Us, hop.uncertaintyUs]),
  ).toEqual([
    ['camera → edge', 5000, 5000],
    ['kernel', 100, 0],
    ['weights, published → loaded', 5000, 0],
  ]);
});
