"""The binarized network: its geometry, its reference arithmetic and its weight blob."""
