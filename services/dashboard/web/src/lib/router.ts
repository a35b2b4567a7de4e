/** The whole view lives in the URL's query: `?page=compare&group=alpha`. Links survive reload and path prefixes. */

import { Value, type Observable } from './observable';

export type Changes = Record<string, string | number | boolean | string[] | null | undefined>;

/** What the URL says to show. */
export class View {
  constructor(readonly query: URLSearchParams = new URLSearchParams()) {}

  static parse(search: string): View {
    return new View(new URLSearchParams(search));
  }

  get page(): string {
    return this.query.get('page') ?? 'runs';
  }

  text(name: string, otherwise = ''): string {
    return this.query.get(name) ?? otherwise;
  }

  /** One of `allowed`, the first of which is the default. */
  choice<T extends string>(name: string, allowed: readonly [T, ...T[]]): T {
    const value = this.query.get(name) as T | null;
    return value !== null && allowed.includes(value) ? value : allowed[0];
  }

  number(name: string, otherwise: number): number {
    const text = this.query.get(name);
    const value = text === null || text === '' ? NaN : Number(text);
    return Number.isFinite(value) ? value : otherwise;
  }

  flag(name: string): boolean {
    return this.query.get(name) === '1';
  }

  list(name: string): string[] {
    return this.query.get(name)?.split(',').filter(Boolean).map(decodeURIComponent) ?? [];
  }

  /** Two numbers `a,b` with a < b, or null. */
  range(name: string): [number, number] | null {
    const [low = NaN, high = NaN] = this.list(name).map(Number);
    return low < high ? [low, high] : null;
  }

  /** All parameters that begin with `prefix`, without it. */
  prefixed(prefix: string): Record<string, string> {
    const found = [...this.query].filter(([key]) => key.startsWith(prefix));
    return Object.fromEntries(found.map(([key, value]) => [key.slice(prefix.length), value]));
  }

  /** This view with some parameters changed; null, '', false and [] remove one. */
  with(changes: Changes): View {
    const query = new URLSearchParams(this.query);
    for (const [key, value] of Object.entries(changes)) {
      const text = Array.isArray(value)
        ? value.map(encodeListItem).join(',')
        : value === true
          ? '1'
          : value === false || value === null || value === undefined
            ? ''
            : String(value);
      if (text === '') query.delete(key);
      else query.set(key, text);
    }
    return new View(query);
  }

  get href(): string {
    const text = this.query.toString().replaceAll('%2C', ',');
    return text ? `?${text}` : '?page=runs';
  }
}

function encodeListItem(item: string): string {
  return item.replace(/[%,]/g, encodeURIComponent);
}

/** A link to a page with parameters. */
export function hrefTo(page: string, changes: Changes = {}): string {
  return new View().with({ page, ...changes }).href;
}

export class Router {
  readonly #view: Value<View>;

  constructor(private readonly browser: Window = window) {
    this.#view = new Value(View.parse(browser.location.search));
    browser.addEventListener('popstate', () => this.#read());
    browser.document.addEventListener('click', (event) => this.#follow(event));
  }

  get view(): Observable<View> {
    return this.#view;
  }

  /** Shows another view as a new entry of the history. */
  go(page: string, changes: Changes = {}): void {
    this.open(hrefTo(page, changes));
  }

  open(href: string): void {
    this.browser.history.pushState(null, '', href);
    this.#read();
    this.browser.scrollTo(0, 0);
  }

  /** Changes parameters of this view; typing, sorting and zooming leave no trail of history entries. */
  update(changes: Changes): void {
    const next = this.#view.value.with({ page: this.#view.value.page, ...changes });
    if (next.href === this.#view.value.href) return;
    this.browser.history.replaceState(null, '', next.href);
    this.#read();
  }

  #read(): void {
    this.#view.set(View.parse(this.browser.location.search));
  }

  #follow(event: MouseEvent): void {
    if (event.defaultPrevented || event.button || event.metaKey || event.ctrlKey || event.shiftKey)
      return;
    const link = (event.target as Element | null)?.closest?.('a[href^="?"]');
    if (!link || link.hasAttribute('download') || link.getAttribute('target')) return;
    event.preventDefault();
    this.open(link.getAttribute('href') ?? '?');
  }
}
