import { expect, test } from 'vitest';
import { Alerts, type Alert } from './alerts';
import { Toasts } from './toasts';

const alert = (id: number, change: Partial<Alert> = {}): Alert => ({
  id,
  at_unix_s: 0,
  kind: 'failed',
  subject: 'r',
  run: 'r',
  text: `alert ${id}`,
  ...change,
});

/** A browser whose reader says this when it is asked. */
function browser(answer: NotificationPermission) {
  const shown: { title: string; body?: string | undefined; onclick?: () => void }[] = [];
  class Shown {
    static permission: NotificationPermission = 'default';
    static requestPermission() {
      Shown.permission = answer;
      return Promise.resolve(answer);
    }
    onclick: () => void = () => {};
    constructor(title: string, options: NotificationOptions) {
      shown.push(Object.assign(this, { title, body: options.body }));
    }
    close() {}
  }
  return { shown, Notification: Shown as unknown as typeof Notification };
}

function storage() {
  const kept = new Map<string, string>();
  return {
    getItem: (name: string) => kept.get(name) ?? null,
    setItem: (name: string, text: string) => void kept.set(name, text),
  };
}

test('an alert is shown in the page, once, and as a notification when somebody wants that', async () => {
  const { shown, Notification } = browser('granted');
  const toasts = new Toasts();
  const opened: string[] = [];
  const alerts = new Alerts(toasts, storage(), (href) => opened.push(href), { Notification });
  alerts.tell(alert(1));
  expect(toasts.all.value.map((toast) => toast.text)).toEqual(['alert 1']);
  expect(shown).toEqual([]);
  await alerts.want(true);
  expect(alerts.consent.value).toBe('on');
  alerts.tell(alert(1)); // told again after a lost connection
  alerts.tell(alert(2, { kind: 'robot_stale', run: null }));
  expect(shown.map(({ title, body }) => [title, body])).toEqual([['Robot is silent', 'alert 2']]);
  shown[0]?.onclick?.();
  expect(opened).toEqual(['?page=system']);
  await alerts.want(false);
  alerts.tell(alert(3));
  expect(shown.length).toBe(1);
});

test('a browser that must not or cannot says so', async () => {
  const denied = new Alerts(new Toasts(), storage(), () => {}, browser('denied'));
  await denied.want(true);
  expect(denied.consent.value).toBe('denied');
  expect(new Alerts(new Toasts(), storage(), () => {}, {}).consent.value).toBe('no');
});
