/** What to do when the connection is back: read again what may have changed meanwhile. */

import type { Observable } from '../observable';
import type { ConnectionStatus } from './client';

/** Calls `read` after every connection but the first, until the returned function is called. */
export function onReconnect(
  connection: Observable<ConnectionStatus | null>,
  read: () => void,
): () => void {
  let lost = false;
  return connection.subscribe((status) => {
    if (status?.state === 'offline') lost = true;
    if (status?.state !== 'online' || !lost) return;
    lost = false;
    read();
  });
}
