/** Light, dark, or as the system says; kept in this browser. */

import type { KeyStorage, ThemeName } from './colour';
import { Value, type Observable } from './observable';

export type ThemeChoice = 'system' | ThemeName;
const CHOICES: readonly ThemeChoice[] = ['system', 'light', 'dark'];
const NAME = 'bpn.theme';

export class Theme {
  readonly #choice: Value<ThemeChoice>;
  readonly #shown: Value<ThemeName>;
  readonly #system: MediaQueryList;

  constructor(
    private readonly root: HTMLElement,
    private readonly storage: KeyStorage,
  ) {
    this.#system = window.matchMedia('(prefers-color-scheme: dark)');
    const kept = storage.getItem(NAME) as ThemeChoice | null;
    this.#choice = new Value(kept !== null && CHOICES.includes(kept) ? kept : 'system');
    this.#shown = new Value(this.#resolve());
    this.#system.addEventListener('change', () => this.#apply());
    this.#apply();
  }

  get choice(): Observable<ThemeChoice> {
    return this.#choice;
  }

  /** The theme that is seen. */
  get shown(): Observable<ThemeName> {
    return this.#shown;
  }

  /** The next of system, light, dark. */
  cycle(): void {
    const next = CHOICES[(CHOICES.indexOf(this.#choice.value) + 1) % CHOICES.length] ?? 'system';
    this.storage.setItem(NAME, next);
    this.#choice.set(next);
    this.#apply();
  }

  #resolve(): ThemeName {
    const choice = this.#choice.value;
    return choice === 'system' ? (this.#system.matches ? 'dark' : 'light') : choice;
  }

  #apply(): void {
    this.root.dataset.theme = this.#resolve();
    this.#shown.set(this.#resolve());
  }
}
