/** Keyboard shortcuts: one key or two in a row ("g r"), listed by `?`. None fires while somebody types. */

import { Value, type Observable } from './observable';

export interface Shortcut {
  keys: string; // as KeyboardEvent.key, two separated by a space
  does: string;
  where: string; // heading in the help
  run: (event: KeyboardEvent) => void;
}

const SEQUENCE_MS = 1200;

export class Keyboard {
  readonly #shortcuts = new Value<readonly Shortcut[]>([]);
  #first = '';
  #firstAtMs = 0;

  constructor(target: Pick<Document, 'addEventListener'>) {
    target.addEventListener('keydown', (event) => this.press(event as KeyboardEvent));
  }

  get shortcuts(): Observable<readonly Shortcut[]> {
    return this.#shortcuts;
  }

  /** Adds shortcuts; returns what takes them away again. Later ones win over earlier ones with the same keys. */
  add(...shortcuts: Shortcut[]): () => void {
    this.#shortcuts.update((all) => [...shortcuts, ...all]);
    return () => this.#shortcuts.update((all) => all.filter((one) => !shortcuts.includes(one)));
  }

  press(event: KeyboardEvent): void {
    if (event.defaultPrevented || event.ctrlKey || event.metaKey || event.altKey) return;
    if (takesText(event.target) || inDialog(event.target)) return;
    const sequence =
      this.#first && event.timeStamp - this.#firstAtMs < SEQUENCE_MS
        ? `${this.#first} ${event.key}`
        : event.key;
    const all = this.#shortcuts.value;
    const match =
      all.find((one) => one.keys === sequence) ?? all.find((one) => one.keys === event.key);
    const begins = !match && all.some((one) => one.keys.startsWith(`${event.key} `));
    this.#first = begins ? event.key : '';
    this.#firstAtMs = event.timeStamp;
    if (!match) return;
    event.preventDefault();
    match.run(event);
  }
}

function takesText(target: EventTarget | null): boolean {
  const element = target as Partial<HTMLElement> | null;
  if (element?.isContentEditable) return true;
  const tag = element?.tagName;
  if (tag === 'TEXTAREA' || tag === 'SELECT') return true;
  return (
    tag === 'INPUT' &&
    !['checkbox', 'radio', 'range', 'button'].includes((target as HTMLInputElement).type)
  );
}

function inDialog(target: EventTarget | null): boolean {
  return Boolean((target as Partial<Element> | null)?.closest?.('dialog'));
}
