/** Short messages at the edge of the page; those with an undo stay for at least ten seconds. */

import { asProblem } from './api/problem';
import { Value, type Observable } from './observable';

export interface Toast {
  id: number;
  kind: 'done' | 'problem' | 'progress';
  text: string;
  detail: string;
  action: { label: string; run: () => void } | null;
  forMs: number;
}

const DONE_MS = 5_000;
const UNDO_MS = 12_000;
const SHOWN = 4;

export class Toasts {
  readonly #all = new Value<readonly Toast[]>([]);
  #next = 1;

  get all(): Observable<readonly Toast[]> {
    return this.#all;
  }

  done(text: string, undo?: () => void): void {
    const action = undo ? { label: 'Undo', run: undo } : null;
    this.#add({ kind: 'done', text, detail: '', action, forMs: undo ? UNDO_MS : DONE_MS });
  }

  /** Something that takes a while: says how far it is until it ends. */
  progress(text: string, cancel: () => void): { say: (text: string) => void; end: () => void } {
    const id = this.#next;
    const action = { label: 'Cancel', run: cancel };
    this.#add({ kind: 'progress', text, detail: '', action, forMs: Infinity });
    return {
      say: (now) =>
        this.#all.update((all) =>
          all.map((toast) => (toast.id === id ? { ...toast, text: now } : toast)),
        ),
      end: () => this.dismiss(id),
    };
  }

  /** Something happened elsewhere that somebody should see to; it stays until it is dismissed. */
  alert(text: string, open: () => void): void {
    const action = { label: 'Show', run: open };
    this.#add({ kind: 'problem', text, detail: '', action, forMs: Infinity });
  }

  /** What went wrong; it stays until it is dismissed. */
  failed(what: string, error: unknown): void {
    const problem = asProblem(error);
    if (problem.signedOut) return; // the sign-in page says it
    const detail = [problem.title, problem.detail].filter(Boolean).join(': ');
    this.#add({ kind: 'problem', text: what, detail, action: null, forMs: Infinity });
  }

  dismiss(id: number): void {
    this.#all.update((all) => all.filter((toast) => toast.id !== id));
  }

  #add(toast: Omit<Toast, 'id'>): void {
    this.#all.update((all) => [...all, { id: this.#next++, ...toast }].slice(-SHOWN));
  }
}
