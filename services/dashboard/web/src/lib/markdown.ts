/**
 * Notes in Markdown as HTML that can do nothing: no scripts, styles, forms, frames or pictures from elsewhere.
 *
 * Tags that somebody wrote are text like any other, so that `use <run>` keeps its word. Both libraries are loaded
 * when the first note is shown.
 */

const TAGS = [
  'p', 'br', 'hr', 'h1', 'h2', 'h3', 'h4', 'ul', 'ol', 'li', 'strong', 'em', 'del', 'code', 'pre', 'blockquote',
  'a', 'table', 'thead', 'tbody', 'tr', 'th', 'td',
]; // prettier-ignore
const HEADINGS = { h1: 'h3', h2: 'h4', h3: 'h5', h4: 'h6' };
const ENTITIES: Record<string, string> = { '&': '&amp;', '<': '&lt;', '>': '&gt;', '\n': '<br>' };

export async function markdownToHtml(text: string): Promise<string> {
  const [{ Marked }, { default: purify }] = await Promise.all([
    import('marked'),
    import('dompurify'),
  ]);
  const marked = new Marked({
    gfm: true,
    breaks: true,
    renderer: {
      html: ({ text, block }) => (block ? `<p>${asText(text.trim())}</p>` : asText(text)),
    },
  });
  const note = purify.sanitize(await marked.parse(text), {
    ALLOWED_TAGS: TAGS,
    ALLOWED_ATTR: ['href', 'title', 'start'],
    ALLOWED_URI_REGEXP: /^(https?:|mailto:|\?)/i,
    RETURN_DOM: true,
  });
  for (const link of note.querySelectorAll('a[href]:not([href^="?"])')) {
    link.setAttribute('target', '_blank');
    link.setAttribute('rel', 'noopener noreferrer');
  }
  return below(note.innerHTML);
}

function asText(html: string): string {
  return html.replace(/[&<>\n]/g, (character) => ENTITIES[character]!);
}

/** A page's headings go on below its own: a note's first is of the third level. */
function below(html: string): string {
  return html.replace(
    /<(\/?)(h[1-4])>/g,
    (_, slash: string, name: keyof typeof HEADINGS) => `<${slash}${HEADINGS[name]}>`,
  );
}
