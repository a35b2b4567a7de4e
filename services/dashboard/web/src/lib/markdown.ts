/**
 * Notes in Markdown as HTML that can do nothing: no scripts, styles, forms, frames or pictures from elsewhere.
 *
 * Both libraries are loaded when the first note is shown.
 */

const TAGS = [
  'p', 'br', 'hr', 'h1', 'h2', 'h3', 'h4', 'ul', 'ol', 'li', 'strong', 'em', 'del', 'code', 'pre', 'blockquote',
  'a', 'table', 'thead', 'tbody', 'tr', 'th', 'td',
]; // prettier-ignore
const HEADINGS = { h1: 'h3', h2: 'h4', h3: 'h5', h4: 'h6' };

export async function markdownToHtml(text: string): Promise<string> {
  const [{ marked }, { default: purify }] = await Promise.all([
    import('marked'),
    import('dompurify'),
  ]);
  const html = await marked.parse(text, { gfm: true, breaks: true });
  const clean = purify.sanitize(html, {
    ALLOWED_TAGS: TAGS,
    ALLOWED_ATTR: ['href', 'title', 'start'],
    ALLOWED_URI_REGEXP: /^(https?:|mailto:|\?)/i,
  });
  return below(clean);
}

/** A page's headings go on below its own: a note's first is of the third level. */
function below(html: string): string {
  return html.replace(
    /<(\/?)(h[1-4])>/g,
    (_, slash: string, name: keyof typeof HEADINGS) => `<${slash}${HEADINGS[name]}>`,
  );
}
