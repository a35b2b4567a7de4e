/** The policy as the edge computes it from the network's outputs (the paper's Eq. 9 and 14). */

/** pi(a|s) = exp(beta P(s,a)) / sum_b exp(beta P(s,b)) for preferences P = lambda * o. */
export function softmax(preferences: readonly number[], beta: number): number[] {
  const top = Math.max(...preferences);
  const weights = preferences.map((p) => Math.exp(beta * (p - top)));
  const sum = weights.reduce((total, weight) => total + weight, 0);
  return weights.map((weight) => weight / sum);
}
