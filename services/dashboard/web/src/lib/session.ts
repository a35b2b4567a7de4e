/** Who is signed in. A token comes in the URL's fragment once, becomes a cookie, and leaves the URL. */

import type { ApiClient } from './api/client';
import { asProblem, type Problem } from './api/problem';
import type { Role, Session } from './api/types';
import { Value, type Observable } from './observable';

export type SessionState =
  | { kind: 'checking' }
  | { kind: 'signed-in'; session: Session }
  | { kind: 'signed-out'; problem: Problem | null }
  | { kind: 'unreachable'; problem: Problem };

const RANKS: readonly Role[] = ['viewer', 'operator', 'admin'];

export class SessionKeeper {
  readonly #state = new Value<SessionState>({ kind: 'checking' });

  constructor(
    private readonly api: ApiClient,
    private readonly browser: Pick<Window, 'location' | 'history'> = window,
  ) {
    let seen = api.signedOut.value;
    api.signedOut.subscribe((n) => {
      if (n !== seen) this.#state.set({ kind: 'signed-out', problem: null });
      seen = n;
    });
  }

  get state(): Observable<SessionState> {
    return this.#state;
  }

  /** Whether the one signed in may do what `role` may. */
  may(role: Role): boolean {
    const state = this.#state.value;
    return state.kind === 'signed-in' && RANKS.indexOf(state.session.role) >= RANKS.indexOf(role);
  }

  /** Takes a token from the URL if there is one, then asks the server who we are. */
  async start(): Promise<void> {
    const token = new URLSearchParams(this.browser.location.hash.slice(1)).get('token');
    if (token) {
      const { pathname, search } = this.browser.location;
      this.browser.history.replaceState(null, '', pathname + search);
      await this.signIn(token);
    } else {
      await this.#ask(null);
    }
  }

  /** Trades a token for a session cookie. */
  async signIn(token: string): Promise<void> {
    this.#state.set({ kind: 'checking' });
    let refused: Problem | null = null;
    try {
      await this.api.session.open(token.trim());
    } catch (error) {
      refused = asProblem(error);
    }
    // A used-up token with a cookie that is still good is no reason to turn anyone away.
    await this.#ask(refused);
  }

  async signOut(): Promise<void> {
    await this.api.session.close();
    this.#state.set({ kind: 'signed-out', problem: null });
  }

  async #ask(refused: Problem | null): Promise<void> {
    try {
      this.#state.set({ kind: 'signed-in', session: await this.api.session.get() });
    } catch (error) {
      const problem = asProblem(error);
      if (problem.signedOut) this.#state.set({ kind: 'signed-out', problem: refused });
      else this.#state.set({ kind: 'unreachable', problem });
    }
  }
}

/** The token in what somebody pasted: the whole URL or the token alone. */
export function tokenIn(pasted: string): string {
  const match = /[#&]token=([^&\s]+)/.exec(pasted);
  return match?.[1] ? decodeURIComponent(match[1]) : pasted.trim();
}
