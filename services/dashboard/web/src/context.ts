/** Hands the page's one `App` to every component. */

import { getContext, setContext } from 'svelte';
import type { App } from './lib/app';

const KEY = Symbol('app');

export function provideApp(app: App): App {
  return setContext(KEY, app);
}

export function useApp(): App {
  return getContext<App>(KEY);
}
