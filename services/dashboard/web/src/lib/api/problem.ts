/** An error of the server (RFC 9457 problem) or of the way to it, in words for the user. */

export interface FieldProblem {
  field: string;
  message: string;
}

export class Problem extends Error {
  override readonly name = 'Problem';

  constructor(
    readonly status: number, // 0: no answer at all
    readonly title: string,
    readonly detail: string = '',
    readonly fields: FieldProblem[] = [],
    readonly type: string = 'about:blank',
  ) {
    super(detail ? `${title}: ${detail}` : title);
  }

  /** No answer: the server is away, or the network. */
  get offline(): boolean {
    return this.status === 0;
  }

  /** The session is missing or over. */
  get signedOut(): boolean {
    return this.status === 401;
  }
}

/** The problem in an answer that was not ok; answers of proxies and crashes are no problem+json. */
export async function problemOf(response: Response): Promise<Problem> {
  const fallback = response.statusText || `The server answered ${response.status}`;
  let body: unknown = null;
  try {
    body = await response.json();
  } catch {
    return new Problem(response.status, fallback);
  }
  if (typeof body !== 'object' || body === null) return new Problem(response.status, fallback);
  const { title, detail, type, errors } = body as Record<string, unknown>;
  return new Problem(
    response.status,
    typeof title === 'string' ? title : fallback,
    typeof detail === 'string' ? detail : '',
    Array.isArray(errors) ? errors.flatMap(fieldProblem) : [],
    typeof type === 'string' ? type : 'about:blank',
  );
}

function fieldProblem(item: unknown): FieldProblem[] {
  if (typeof item !== 'object' || item === null) return [];
  const { location, message } = item as Record<string, unknown>;
  if (typeof location !== 'string' || typeof message !== 'string') return [];
  return [{ field: location.replace(/^body\.(config\.)?/, ''), message }];
}

/** Any thrown value as a problem, so that views show one kind of error. */
export function asProblem(error: unknown): Problem {
  if (error instanceof Problem) return error;
  return new Problem(-1, 'Something went wrong in this page', String(error));
}
