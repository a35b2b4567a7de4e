/** What every view needs, made once per page: server, session, live connection, URL, keyboard, messages. */

import { Alerts } from './alerts';
import { ApiClient } from './api/client';
import type { ConfigSchema } from './api/types';
import { StrokeBook, type KeyStorage } from './colour';
import { Keyboard } from './keyboard';
import { LiveClient, type ConnectionStatus } from './live/client';
import { Value } from './observable';
import { Router } from './router';
import { SessionKeeper } from './session';
import type { StartRequest } from './start';
import { exposeStats } from './stats';
import { Theme } from './theme';
import { Ticker } from './ticker';
import { Toasts } from './toasts';

export class App {
  readonly api = new ApiClient();
  readonly session = new SessionKeeper(this.api);
  readonly router = new Router();
  readonly keyboard = new Keyboard(document);
  readonly toasts = new Toasts();
  readonly storage: KeyStorage = safeStorage();
  readonly alerts = new Alerts(this.toasts, this.storage, (href) => this.router.open(href));
  readonly theme = new Theme(document.documentElement, this.storage);
  readonly strokes = new StrokeBook(this.storage);
  readonly connection = new Value<ConnectionStatus | null>(null);
  readonly live = new LiveClient(liveUrl(), { onStatus: (status) => this.connection.set(status) });
  readonly ticker = new Ticker(() => this.live.clock.nowUnixS());
  /** What is about to be started; null: nothing. */
  readonly starting = new Value<StartRequest | null>(null);
  #schema: Promise<ConfigSchema> | null = null;

  constructor() {
    exposeStats();
  }

  /** Schema and presets of run configurations; asked for once, again after a failure. */
  configSchema(): Promise<ConfigSchema> {
    this.#schema ??= this.api.configSchema().catch((error: unknown) => {
      this.#schema = null;
      throw error;
    });
    return this.#schema;
  }
}

function liveUrl(): string {
  return new URL('api/v1/live', document.baseURI).href.replace(/^http/, 'ws');
}

/** The browser's storage, or memory where that is forbidden. */
function safeStorage(): KeyStorage {
  try {
    localStorage.getItem('');
    return localStorage;
  } catch {
    const kept = new Map<string, string>();
    return {
      getItem: (name) => kept.get(name) ?? null,
      setItem: (name, text) => kept.set(name, text),
    };
  }
}
