"""Policies: the reference arithmetic of binarized networks, and weights of either kind as bytes."""
