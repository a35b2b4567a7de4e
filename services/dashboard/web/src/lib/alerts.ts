/** Alerts of the dashboard in this browser: as a message in the page, and as a notification where the reader wants that. */

import type { components } from '../../generated/api';
import type { KeyStorage } from './colour';
import type { LiveClient } from './live/client';
import { topics } from './live/topics';
import { Value, type Observable } from './observable';
import { hrefTo } from './router';
import type { Toasts } from './toasts';

export type Alert = components['schemas']['Alert'];
export type AlertPage = components['schemas']['AlertPage'];

export const ALERT_TITLES: Record<Alert['kind'], string> = {
  failed: 'Run failed',
  stalled: 'Run stands still',
  robot_stale: 'Robot is silent',
  return_fell: 'Return fell',
};

/** 'no': the browser, or this address without TLS, cannot; 'denied': the reader said no to the browser. */
export type Consent = 'on' | 'off' | 'denied' | 'no';

const NAME = 'bpn.notify';

export class Alerts {
  readonly #consent: Value<Consent>;
  readonly #newest = new Value<Alert | null>(null);

  constructor(
    private readonly toasts: Toasts,
    private readonly storage: KeyStorage,
    private readonly open: (href: string) => void,
    private readonly browser: { Notification?: typeof Notification } = globalThis,
  ) {
    this.#consent = new Value(this.#asked());
  }

  get consent(): Observable<Consent> {
    return this.#consent;
  }

  /** The last one that came while this page was open. */
  get newest(): Observable<Alert | null> {
    return this.#newest;
  }

  /** Hears of alerts until the returned function is called. */
  listen(live: LiveClient): () => void {
    return live.subscribe(topics.alerts, { onData: (data) => this.tell(data as Alert) });
  }

  /** Asks the browser for its consent, or takes it back. */
  async want(on: boolean): Promise<void> {
    this.storage.setItem(NAME, on ? 'on' : 'off');
    if (on && this.browser.Notification?.permission === 'default')
      await this.browser.Notification.requestPermission();
    this.#consent.set(this.#asked());
  }

  tell(alert: Alert): void {
    if (alert.id <= (this.#newest.value?.id ?? 0)) return;
    this.#newest.set(alert);
    const href = alert.run ? hrefTo('run', { run: alert.run }) : hrefTo('system');
    this.toasts.alert(alert.text, () => this.open(href));
    if (this.#consent.value !== 'on' || !this.browser.Notification) return;
    const shown = new this.browser.Notification(ALERT_TITLES[alert.kind], {
      body: alert.text,
      tag: `bpn-${alert.id}`, // several pages of one browser show it once
    });
    shown.onclick = () => {
      globalThis.focus?.();
      this.open(href);
      shown.close();
    };
  }

  #asked(): Consent {
    const permission = this.browser.Notification?.permission;
    if (permission === undefined) return 'no';
    if (permission === 'denied') return 'denied';
    return permission === 'granted' && this.storage.getItem(NAME) === 'on' ? 'on' : 'off';
  }
}
