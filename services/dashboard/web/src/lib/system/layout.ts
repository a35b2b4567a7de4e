/**
 * Where the boxes and arrows of the system's picture stand. The kinds of services are known, so the columns are:
 * robots, edges, learner; a run's slots are its rows. Workers without a run stand below.
 */

import type { Link, Node, Topology } from './topology';

export const BOX = { width: 200, height: 62 } as const;
const GAP = { column: 170, row: 14, group: 20 } as const;
const TITLE_HEIGHT = 26;
const PADDING = 12;
const COLUMNS = ['robot_sim', 'edge', 'learner'];

export interface Box {
  node: Node;
  x: number;
  y: number;
}

export interface Group {
  /** The run's id; null: workers without a run. */
  run: string | null;
  x: number;
  y: number;
  width: number;
  height: number;
}

/** One or both directions between two boxes. */
export interface Arrow {
  from: Box;
  to: Box;
  link: Link;
  path: string;
  label: { x: number; y: number; anchor: 'start' | 'middle' };
}

export interface Picture {
  width: number;
  height: number;
  groups: Group[];
  boxes: Box[];
  arrows: Arrow[];
}

const WIDTH = 2 * PADDING + COLUMNS.length * BOX.width + (COLUMNS.length - 1) * GAP.column;

/** Nodes of other kinds (the dashboard) are not drawn: they take no part in learning. */
export function layout(topology: Topology): Picture {
  const workers = topology.nodes.filter((node) => COLUMNS.includes(node.kind));
  const runs = [...new Set(workers.map((node) => node.run))].sort(idleLast);
  const groups: Group[] = [];
  const boxes: Box[] = [];
  let y = 0;
  for (const run of runs) {
    const members = workers.filter((node) => node.run === run);
    const rows = Math.max(...COLUMNS.map((kind) => members.filter((n) => n.kind === kind).length));
    const height = TITLE_HEIGHT + rows * (BOX.height + GAP.row) - GAP.row + PADDING;
    groups.push({ run, x: 0, y, width: WIDTH, height });
    COLUMNS.forEach((kind, column) => {
      const own = members.filter((node) => node.kind === kind);
      const x = PADDING + column * (BOX.width + GAP.column);
      // A learner of several slots stands in the middle of them.
      const free = run === null ? 0 : (rows - own.length) * (BOX.height + GAP.row);
      own.forEach((node, row) => {
        const top = y + TITLE_HEIGHT + free / 2 + row * (BOX.height + GAP.row);
        boxes.push({ node, x, y: top });
      });
    });
    y += height + GAP.group;
  }
  const byId = new Map(boxes.map((box) => [box.node.id, box]));
  const arrows = SHOWN.flatMap(({ topic, offset }) =>
    topology.links
      .filter((link) => link.topic === topic)
      .flatMap((link) => {
        const [from, to] = [byId.get(link.source), byId.get(link.target)];
        return from && to ? [arrow(from, to, link, offset)] : [];
      }),
  );
  return { width: WIDTH, height: Math.max(0, y - GAP.group), groups, boxes, arrows };
}

/** What is drawn between two services, and how far below the boxes' middle. */
const SHOWN = [
  { topic: 'frame', offset: -14 },
  { topic: 'action', offset: 14 },
  { topic: 'episode', offset: -14 },
  { topic: 'weights', offset: 14 },
];

function arrow(from: Box, to: Box, link: Link, offset: number): Arrow {
  const forward = from.x < to.x;
  const x1 = forward ? from.x + BOX.width : from.x;
  const x2 = forward ? to.x : to.x + BOX.width;
  const y1 = from.y + BOX.height / 2 + offset;
  const y2 = to.y + BOX.height / 2 + offset;
  const bend = (x2 - x1) / 2;
  const above = offset < 0 ? -6 : 14; // the curve is flat at the left box: the label stands along it
  const tip = forward ? -4 : 4; // the arrowhead's length
  return {
    from,
    to,
    link,
    path: `M${x1} ${y1}C${x1 + bend} ${y1} ${x2 - bend} ${y2} ${x2 + tip} ${y2}`,
    label:
      y1 === y2
        ? { x: x1 + bend, y: y1 + above, anchor: 'middle' }
        : { x: Math.min(x1, x2) + 8, y: (forward ? y1 : y2) + above, anchor: 'start' },
  };
}

function idleLast(one: string | null, other: string | null): number {
  if (one === null || other === null) return Number(one === null) - Number(other === null);
  return one < other ? -1 : 1;
}
