"""The learner: turns episodes into binarized weights by Conservative Value Iteration; knows torch."""
