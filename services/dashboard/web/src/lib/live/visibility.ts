/**
 * Whether somebody can see an element: it is on screen and the tab is not hidden. What is costly to send
 * or draw is asked for only then.
 */

/** Calls `onChange` with the present state soon, and at every change, until the returned function is called. */
export function watchVisible(element: Element, onChange: (visible: boolean) => void): () => void {
  let onScreen = false;
  let reported: boolean | null = null;
  const report = () => {
    const visible = onScreen && !document.hidden;
    if (visible !== reported) onChange((reported = visible));
  };
  const observer = new IntersectionObserver((entries) => {
    onScreen = entries.at(-1)?.isIntersecting ?? false;
    report();
  });
  observer.observe(element);
  document.addEventListener('visibilitychange', report);
  return () => {
    observer.disconnect();
    document.removeEventListener('visibilitychange', report);
  };
}
