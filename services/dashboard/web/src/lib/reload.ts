/** A page whose code does not come, as after an upgrade of the server: read anew, once, instead of asked for again. */

import type { KeyStorage } from './colour';

const NAME = 'bpn.reloaded';
const AGAIN_AFTER_MS = 60_000;

/** Whether the page is to be read anew; not when that was just done and did not help. */
export function mayReload(storage: KeyStorage, nowMs: number): boolean {
  const beforeMs = Number(storage.getItem(NAME) ?? NaN);
  if (nowMs - beforeMs < AGAIN_AFTER_MS) return false;
  storage.setItem(NAME, String(nowMs));
  return true;
}
