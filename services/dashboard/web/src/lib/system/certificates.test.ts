import fc from 'fast-check';
import { expect, test } from 'vitest';
import { certificateRows, certificateSentences, days, type Certificate } from './certificates';

const DAY_S = 86400;

function certificate(kind: string, id: string, left: number, nearEnd = left < 30): Certificate {
  return { kind, id, end_unix_s: left * DAY_S, days_left: left, near_end: nearEnd };
}

test('workers that share a certificate are one row, and the first to end comes first', () => {
  const rows = certificateRows([
    certificate('router', '', 300),
    certificate('edge', 'edge-1', 20),
    certificate('edge', 'edge-2', 20),
    certificate('edge', 'edge-3', 200),
  ]);
  expect(rows.map((row) => [row.name, row.ids, row.state])).toEqual([
    ['Edge', ['edge-1', 'edge-2'], 'near its end'],
    ['Edge', ['edge-3'], 'good'],
    ['Router', [], 'good'],
  ]);
});

test('what is near its end is said with its days and the remedy, what has expired as expired', () => {
  const rows = certificateRows([
    certificate('web', '', -0.5),
    certificate('robot_sim', 'a', 29.9),
    certificate('robot_sim', 'b', 29.9),
    certificate('learner', 'c', 2.57),
    certificate('dashboard', '', 30),
  ]);
  expect(certificateSentences(rows)).toEqual([
    'Certificate of the web address has expired: renew it with bpn-certificates.',
    'Certificate of the learner ends in 2.5 days: renew it with bpn-certificates.',
    'Certificate of the robot (2 workers) ends in 29 days: renew it with bpn-certificates.',
  ]);
});

test('no days are promised that are not there', () => {
  fc.assert(
    fc.property(fc.double({ min: 0, max: 4000, noNaN: true }), (left) => {
      expect(Number(days(left).replace(',', ''))).toBeLessThanOrEqual(left);
    }),
  );
});

test('every certificate that the server tells of is in one row', () => {
  const some = fc.array(
    fc.record({
      kind: fc.constantFrom('edge', 'learner'),
      id: fc.uuid(),
      left: fc.integer({ min: -9, max: 99 }),
    }),
  );
  fc.assert(
    fc.property(some, (all) => {
      const rows = certificateRows(all.map(({ kind, id, left }) => certificate(kind, id, left)));
      expect(rows.flatMap((row) => row.ids).sort()).toEqual(all.map(({ id }) => id).sort());
      expect(certificateSentences(rows).length).toBe(
        rows.filter((row) => row.daysLeft < 30).length,
      );
    }),
  );
});
