/** The policy as the edge computes it from the network's outputs (the paper's Eq. 9 and 14). */

/** The inverse temperature with which a run's weights version plays: on a line over the run. */
export function betaOf(config: Readonly<Record<string, unknown>>, version: number): number {
  const last = Number(config.iterations ?? 1) - 1;
  const share = Math.min(version, last) / Math.max(1, last);
  const factor = Number(config.beta_run_final_factor ?? 1);
  return Number(config.beta ?? 1) * (1 + share * (factor - 1));
}

/** pi(a|s) = exp(beta P(s,a)) / sum_b exp(beta P(s,b)) for preferences P = lambda * o. */
export function softmax(preferences: readonly number[], beta: number): number[] {
  const top = Math.max(...preferences);
  const weights = preferences.map((p) => Math.exp(beta * (p - top)));
  const sum = weights.reduce((total, weight) => total + weight, 0);
  return weights.map((weight) => weight / sum);
}

/** The same in each dimension of an action by itself, side by side as the preferences are. */
export function softmaxOfEach(
  preferences: readonly number[],
  beta: number,
  dims: readonly number[],
): number[] {
  return starts(dims).flatMap((first, d) =>
    softmax(preferences.slice(first, first + (dims[d] ?? 0)), beta),
  );
}

/** An action's choice in each dimension, by its number, in which the last dimension counts fastest. */
export function choicesOf(action: number, dims: readonly number[]): number[] {
  const choices: number[] = [];
  let rest = action;
  for (const count of [...dims].reverse()) {
    choices.unshift(rest % count);
    rest = Math.floor(rest / count);
  }
  return choices;
}

/** Which of what is side by side for every choice belong to an action, one of each dimension. */
export function outputsTaken(action: number, dims: readonly number[]): number[] {
  const first = starts(dims);
  return choicesOf(action, dims).map((choice, d) => (first[d] ?? 0) + choice);
}

/** Where each dimension begins among what is side by side. */
export function starts(dims: readonly number[]): number[] {
  let at = 0;
  return dims.map((count) => (at += count) - count);
}

/** What an action does, in words. */
export function actionName(
  action: number,
  names: readonly string[],
  dims: readonly number[],
): string {
  const taken = outputsTaken(action, dims).map((output) => names[output]);
  return taken.every((name) => name !== undefined) ? taken.join(', ') : `action ${action}`;
}
