/** The theme's colours, for drawings. */

import type { Ink } from './drawing';

export function inkOf(element: Element): Ink {
  const styles = getComputedStyle(element);
  const colour = (name: string): string => long(styles.getPropertyValue(name).trim());
  return {
    text: colour('--text'),
    muted: colour('--muted'),
    line: colour('--line'),
    background: colour('--surface'),
  };
}

/** "#abc" as "#aabbcc". */
function long(hex: string): string {
  return /^#[0-9a-f]{3}$/i.test(hex) ? hex.replace(/[0-9a-f]/gi, '$&$&') : hex;
}
