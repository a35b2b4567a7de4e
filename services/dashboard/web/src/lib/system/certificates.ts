/** Certificates and how long they are good: services of a kind mostly share one. */

import type { SystemStatus } from '../api/types';
import { number } from '../format';

export type Certificate = SystemStatus['certificates'][number];

export interface CertificateRow {
  /** Whose it is: "Router", "Edge". */
  name: string;
  /** The workers that have it; none where there is one service of the kind. */
  ids: string[];
  endUnixS: number;
  daysLeft: number;
  state: 'good' | 'near its end' | 'expired';
}

const NAMES: Record<string, string> = {
  router: 'Router',
  dashboard: 'Dashboard',
  web: 'Web address',
  learner: 'Learner',
  edge: 'Edge',
  robot_sim: 'Robot',
};

/** One row for every certificate, the first to end first. */
export function certificateRows(certificates: Certificate[]): CertificateRow[] {
  const rows = new Map<string, CertificateRow>();
  for (const { kind, id, end_unix_s, days_left, near_end } of certificates) {
    const key = `${kind} ${end_unix_s}`;
    const row = rows.get(key) ?? {
      name: NAMES[kind] ?? kind,
      ids: [],
      endUnixS: end_unix_s,
      daysLeft: days_left,
      state: days_left <= 0 ? 'expired' : near_end ? 'near its end' : 'good',
    };
    if (id) row.ids.push(id);
    rows.set(key, row);
  }
  return [...rows.values()].sort((one, other) => one.endUnixS - other.endUnixS);
}

/** Days as people read them: whole ones, and tenths for the last ten. */
export function days(left: number): string {
  return number(Math.abs(left) < 10 ? Math.floor(left * 10) / 10 : Math.floor(left));
}

/** What is to be said beforehand of those that are near their end or past it. */
export function certificateSentences(rows: CertificateRow[]): string[] {
  return rows
    .filter((row) => row.state !== 'good')
    .map((row) => {
      const shared = row.ids.length > 1 ? ` (${row.ids.length} workers)` : '';
      const whose = row.name.toLowerCase() + shared;
      const what = row.state === 'expired' ? 'has expired' : `ends in ${days(row.daysLeft)} days`;
      return `Certificate of the ${whose} ${what}: renew it with bpn-certificates.`;
    });
}
