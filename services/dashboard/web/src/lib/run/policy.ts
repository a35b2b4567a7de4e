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
