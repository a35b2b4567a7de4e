"""Groups of runs compared by what their seeds came to: numbers, verdicts, and one sentence."""
