/** Rows that are drawn: those in view and some around them, so that a fast scroll shows no holes. */
const AROUND = 12;

/** First and last (exclusive) of `count` rows of equal height to draw. */
export function windowOf(
  count: number,
  rowPx: number,
  scrollTopPx: number,
  heightPx: number,
): { first: number; last: number } {
  const top = Math.floor(scrollTopPx / rowPx);
  const visible = Math.ceil(heightPx / rowPx) + 1;
  const first = Math.max(0, Math.min(top, count - visible) - AROUND);
  return { first, last: Math.min(count, top + visible + AROUND) };
}
